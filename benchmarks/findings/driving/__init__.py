"""Measurements of how vehicles are driven, and by whom.

In comes simulated traffic; out come counts and distributions of what its vehicles do.
"""
