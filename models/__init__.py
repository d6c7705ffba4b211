"""From samples to a measured predictor: windows, predictors, training, scores, evaluation, reports, studies."""

import isacsim as isacsim  # Before any library that starts threads.
