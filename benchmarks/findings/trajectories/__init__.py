"""Measurements behind docs/real_data.md.

In come files of trajectories, written for the purpose; out come events, costs and what is lost of them.
"""
