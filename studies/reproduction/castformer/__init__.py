"""The experiments of the CaSTFormer paper.

In come windows of simulated motion, or feature files of clips; out come the files of the stages, and the page made of
them.
"""
