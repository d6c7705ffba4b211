"""Measures trained predictors on windows that they have not seen, and writes their scores and every prediction.

It knows nothing of figures, pages or studies.
"""
