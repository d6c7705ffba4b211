"""Measurements behind docs/sensing.md.

In come datasets and simulated traffic; out come the errors, losses and costs of sensing them.
"""
