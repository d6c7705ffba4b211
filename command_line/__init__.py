"""What the commands of `cosim` share: their options, and how results are shown to people.

In come arguments; out come settings, tables on standard error, and the object that `--json` prints.
"""
