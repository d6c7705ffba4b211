"""Streams: stretches of driving that are sensed throughout, with their events, in running traffic and stored as data.

In come episodes; out come stretches as the network senses them, the reports of UVs, and events.

Knows nothing of predictors. Windows are cut from a stream when it is read.
"""
