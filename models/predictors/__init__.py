"""The predictors of intentions, one file each, and their registry. Knows nothing of run folders or evaluation."""
