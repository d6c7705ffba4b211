"""Evaluates predictors in running traffic: senses and predicts vehicles all the time, raises alarms, and scores them.

It draws no figures, and knows nothing about advisories, reports or the command line.
"""
