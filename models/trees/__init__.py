"""Boosted trees: how they are fitted and stored, whatever they are for."""
