"""Trains any registered predictor on records, and leaves a run's folder. Knows no predictor by name."""
