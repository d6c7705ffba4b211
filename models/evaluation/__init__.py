"""Measures trained predictors on windows that they have not seen, and writes what it measured to `metrics.json`.

It knows nothing of figures, pages or studies.
"""
