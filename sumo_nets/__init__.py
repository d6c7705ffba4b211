"""Bundled scenarios, one folder each."""
