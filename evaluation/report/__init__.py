"""Draws what an evaluation measured: figures, tables for the terminal, and the HTML page called the report.

It measures nothing itself and knows nothing of studies.
"""
