"""Measurements behind docs/real_data.md."""
