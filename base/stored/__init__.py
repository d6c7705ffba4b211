"""Files of others, and what is checked before their content is used: digests, archives, arrays, tables.

A file may have been damaged or made to do harm. What it claims of its sizes is held against what it is, so that reading
it takes no more memory than it deserves; nothing in it is executed.
"""
