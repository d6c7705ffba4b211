"""The predictors of intentions, one file each, and their registry. Knows nothing of run folders or evaluation.

In come labelled windows to fit to, and then windows to answer; out come logits of the known intentions, and features.
"""
