"""Runs whole studies, from the settings in a TOML file to a report: a single predictor, or a sweep of many.

It composes generation, training, evaluation and report, and knows nothing of the command line but its text formats.
"""
