"""Generates datasets: runs the episodes of a study on worker processes, and senses existing records anew.

In come a study or a dataset; out comes a dataset, the same on any number of workers.

Knows nothing of windows, predictors or the command line.
"""
