"""One vehicle in the hands of one driver: what it sees, how a person moves pedals and wheel, and how SUMO obeys.

In come a goal and what the driver sees; out come speeds and lateral positions, step by step.
"""
