"""From samples to a trained predictor: windows, networks, predictors, training, and scores of the unknown class."""

DEFAULT = "asi-bip"
"""The predictor that is trained when none is named."""
FLOOR = "trees"
"""The plain predictor that every other one is compared with."""
