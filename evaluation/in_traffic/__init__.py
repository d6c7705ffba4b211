"""Evaluates predictors in running traffic: senses and predicts vehicles all the time, raises alarms, and scores them.

In come runs, a scenario and seeds; out comes `metrics.json`, with the answers of every episode beside it.

It draws no figures, and knows nothing about advisories, reports or the command line.
"""
