"""A whole run as one file: reading, running and sweeping studies, the bundled ones, and both papers' experiments.

In comes a TOML file; out come a dataset, runs, evaluations and a page, or the table of a sweep.
"""
