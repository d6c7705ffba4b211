"""Alarm settings chosen on the development seeds, measured on the others, and the whole evaluation."""
