"""Which stretches of traffic are watched, how they are sensed and predicted, and how the answers are stored.

In come a scenario, a seed and predictors; out comes a file an episode: the answers to every watched vehicle, and the
events.
"""
