"""The experiments of the ASI-BIP paper.

In comes simulated motion; out come the files of the stages, and the page made of them.
"""
