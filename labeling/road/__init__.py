"""Vehicles relative to their road: lanes, driven paths, motion along and across the road, and who is around whom.

In come a recording and its lanes; out come positions, motion and neighbours along the road.

This room describes motion and does not know which maneuvers it amounts to.
"""
