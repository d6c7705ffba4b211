"""How far a predictor's answers can be trusted: calibration, and scores that recognise unknown maneuvers.

Knows nothing of how predictors are trained or evaluated.
"""
