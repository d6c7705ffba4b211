"""Draws what an evaluation measured: figures, tables for the terminal, and the HTML page called the report.

In comes a result; out come PNG files, tables on the terminal, and one HTML file.

It measures nothing itself and knows nothing of studies.
"""
