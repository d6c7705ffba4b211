"""The replay: records of an episode as a road that moves, seen from above. What is shown, and where it comes from."""
