"""Predictors trained on streams: of every intention, whether it begins within some horizons, each with its own sigmoid.

In come decisions along watched driving with the events around them; out come predictors that answer windows with the
log-odds of every intention, independent of each other.
"""
