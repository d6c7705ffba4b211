"""The replay: records of an episode as a road that moves, seen from above. What is shown, and where it comes from.

In come an episode of a dataset or the moments of an evaluation; out come paths, answers and alarms, packed for a page.
"""
