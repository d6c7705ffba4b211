"""From a recording to labelled samples: detectors, pairs, candidates, datasets. It knows nothing of predictors."""
