"""What was driven: the states of all vehicles, logged at every step or rebuilt from samples.

In come the states that SUMO tells; out comes a `Recording`.
"""
