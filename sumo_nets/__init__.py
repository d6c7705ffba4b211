"""The bundled scenarios, one folder each, and what their build scripts share.

In come the numbers in a folder's `build.py`; out come the files of its scenario, which are stored beside it.
"""
