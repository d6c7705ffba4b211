"""Templates, style and scripts of the pages, and what fills them in: HTML in which every text is escaped.

In come the parts of a result; out comes a page that needs no other file.
"""
