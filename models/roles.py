"""The two predictors that the rest of the project refers to by name. Imports nothing, so that help answers at once."""

DEFAULT = "asi-bip"
"""The predictor that is trained when none is named."""
FLOOR = "trees"
"""The plain predictor that every other one is compared with."""
