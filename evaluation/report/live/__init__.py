"""The figures of an evaluation in running traffic.

In comes the result of an evaluation in traffic; out come PNG files.
"""
