"""Measurements behind docs/sensing.md."""
