"""Reproduces the experiments of both papers, stage by stage, as tables and figures beside the papers' own numbers.

It composes generation, training and evaluation, and knows nothing of the command line.
"""
