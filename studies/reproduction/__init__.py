"""Reproduces the experiments of both papers, stage by stage, as tables and figures beside the papers' own numbers.

In comes the name of a paper; out come a file for each stage, and a page with a verdict on each claim.

It composes generation, training and evaluation, and knows nothing of the command line.
"""
