"""Trains any registered predictor on records, and leaves a run's folder. Knows no predictor by name.

In come records or streams, and settings; out comes the folder of a run.
"""
