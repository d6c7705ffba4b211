"""Alarms against what happened: events, matching, and the curve of recall over false alarms."""
