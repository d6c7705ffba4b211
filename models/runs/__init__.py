"""A trained predictor on disk: its folder, its card, and the settings of its training.

In come settings and the parts of a trained predictor; out comes a folder, and from it a predictor that answers windows.
"""
