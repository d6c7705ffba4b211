"""Calibration: whether a probability of 0.9 is right nine times in ten, and the temperature that corrects it."""

from __future__ import annotations

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.special import log_softmax

from isac_cosim.base.arrays import Array, IntArray

BINS = 15
"""Equal bins of confidence."""
RANGE = (0.05, 20.0)
"""Least and greatest temperature."""


def fit_temperature(logits: Array, label: IntArray) -> float:
    """Return the temperature, within RANGE, by which logits (n, G) are divided to make labels (n,) most likely.

    It is 1 without any labels.
    Source: Guo et al. 2017, Section 4.2.
    """
    if not len(label):
        return 1.0

    def loss(log_t: float) -> float:
        return -float(log_softmax(logits / np.exp(log_t), axis=1)[np.arange(len(label)), label].mean())

    minimum = minimize_scalar(loss, bounds=(np.log(RANGE[0]), np.log(RANGE[1])), method="bounded")
    return float(np.exp(minimum.x))


def calibration_error(probabilities: Array, label: IntArray) -> float:
    """Return the expected calibration error: the mean gap between confidence and accuracy over BINS equal bins.

    probabilities: (n, G); label: (n,). Source: Guo et al. 2017, Eq. (3).
    """
    confidence, hit = probabilities.max(axis=1), probabilities.argmax(axis=1) == label
    bin_number = np.minimum((confidence * BINS).astype(int), BINS - 1)
    gap = np.bincount(bin_number, confidence - hit, minlength=BINS)
    return float(np.abs(gap).sum() / max(len(label), 1))
