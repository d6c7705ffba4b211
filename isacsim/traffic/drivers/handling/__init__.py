"""One vehicle in the hands of one driver: what it sees, how a person moves pedals and wheel, and how SUMO obeys."""
