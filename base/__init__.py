"""What every package rests on: errors, files, settings, registries, random streams, progress, workers.

In come plain values, files and tasks; out come checked settings, files that are written whole, and results.
"""
