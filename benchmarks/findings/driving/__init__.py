"""Measurements of how vehicles are driven, and by whom."""
