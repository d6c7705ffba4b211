"""Vehicles relative to their road: lanes, driven paths, motion along and across the road, and who is around whom.

This room describes motion and does not know which maneuvers it amounts to.
"""
