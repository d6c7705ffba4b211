"""Commands that are not in `cosim.py`: each is a module, and `registration` adds them.

In come arguments; out come files, and what the command shows of them.
"""
