"""Episodes and records for other programs: floating car data that SUMO replays, CSV tables, scenes for Foxglove.

In come an episode of a dataset, which is simulated again, or a record; out comes a folder that the other program opens.
"""
