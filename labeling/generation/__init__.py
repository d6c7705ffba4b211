"""Generates datasets: runs the episodes of a study on worker processes, and senses existing records anew.

Knows nothing of windows, predictors or the command line.
"""
