"""From the records of a dataset to windows, and variations of them. Knows nothing of predictors."""
