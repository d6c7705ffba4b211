"""Alarms against what happened: events, matching, and the curve of recall over false alarms.

In come alarms and events; out come recall, lead times and false alarms per vehicle-hour, with intervals over seeds.
"""
