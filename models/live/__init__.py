"""A predictor in running traffic: continuous streams of every watched vehicle, the alarms raised on them, their scores.

It draws no figures, and knows nothing of studies, reports or the command line.
"""
