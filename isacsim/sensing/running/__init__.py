"""Sensing in a world that runs: step by step, with nothing of the future."""
