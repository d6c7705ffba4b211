"""A trained predictor on disk: its folder, its card, and the settings of its training."""
