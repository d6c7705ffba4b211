"""Whether a probability of 0.9 is right nine times in ten, and the temperature that mends it."""

from __future__ import annotations

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.special import log_softmax

from isacsim.arrays import Array, IntArray

BINS = 15
RANGE = (0.05, 20.0)


def fit_temperature(logits: Array, label: IntArray) -> float:
    """The temperature, within RANGE, that makes labels (n,) likeliest under logits (n, G) divided by it; 1 without any.

    Source: Guo et al. 2017, Section 4.2.
    """
    if not len(label):
        return 1.0

    def loss(log_t: float) -> float:
        return -float(log_softmax(logits / np.exp(log_t), axis=1)[np.arange(len(label)), label].mean())

    found = minimize_scalar(loss, bounds=(np.log(RANGE[0]), np.log(RANGE[1])), method="bounded")
    return float(np.exp(found.x))


def calibration_error(probabilities: Array, label: IntArray) -> float:
    """Expected calibration error: mean gap between confidence and accuracy over BINS equal bins of confidence.

    probabilities: (n, G); label: (n,). Source: Guo et al. 2017, Eq. (3).
    """
    confidence, hit = probabilities.max(axis=1), probabilities.argmax(axis=1) == label
    place = np.minimum((confidence * BINS).astype(int), BINS - 1)
    gap = np.bincount(place, confidence - hit, minlength=BINS)
    return float(np.abs(gap).sum() / max(len(label), 1))
