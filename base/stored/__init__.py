"""Files of others, and what is checked before their content is used: digests, archives, arrays, tables.

In comes a file of somebody else; out come arrays and tables that are what the file says, or one line that says what is
wrong with it.

A file may have been damaged or made to do harm. What it claims of its sizes is held against what it is, so that reading
it takes no more memory than it deserves; nothing in it is executed.
"""
