"""Boosted trees: how they are fitted and stored, whatever they are for.

In come features and labels; out come fitted trees, and files of them.
"""
