"""Measures trained predictors on windows that they have not seen, and writes their scores and every prediction.

In come runs and a dataset; out come `metrics.json` and `predictions.parquet`.

It knows nothing of figures, pages or studies.
"""
