"""Sensing in a world that runs: step by step, with nothing of the future.

In come the states of a running simulation; out comes conditioned motion, piece by piece.
"""
