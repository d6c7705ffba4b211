"""Alarm settings chosen on the development seeds, measured on the others, and the whole evaluation.

In come the stored answers of both kinds of seeds; out comes the content of `metrics.json`.
"""
