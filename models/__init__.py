"""From a dataset to a measured intention predictor."""
