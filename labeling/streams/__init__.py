"""Streams: stretches of driving that are sensed throughout, with their events, in running traffic and stored as data.

Knows nothing of predictors. Windows are cut from a stream when it is read.
"""
