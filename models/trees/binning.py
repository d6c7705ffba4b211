"""The bins of weighted features, found by sorting each feature once.

scikit-learn 1.9 sorts a feature once for each of 254 bins where samples have weights, which takes longer than all the
boosting (its issue 34304, mended in what follows 1.9). The bins here are the same to the last bit.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache

import numpy as np

from isac_cosim.base.arrays import Array

SLOW = "1.9."
"""Versions that are helped begin like this."""


@contextmanager
def sorted_once() -> Iterator[None]:
    """Let scikit-learn find the bins of weighted features as this module does, where it is slow at it.

    Threads may fit at the same time: the one that ends first gives the others the slow way back.
    """
    import sklearn
    from sklearn.ensemble._hist_gradient_boosting import binning

    if not sklearn.__version__.startswith(SLOW):
        yield
        return
    theirs = _theirs()
    binning._find_binning_thresholds = thresholds
    try:
        yield
    finally:
        binning._find_binning_thresholds = theirs


@cache
def _theirs() -> Callable[..., Array]:
    """Return what scikit-learn finds bins with, as it is before anything takes its place."""
    from sklearn.ensemble._hist_gradient_boosting import binning

    found: Callable[..., Array] = binning._find_binning_thresholds
    return found


def thresholds(column: Array, most_bins: int, sample_weight: Array | None = None) -> Array:
    """Return what separates the bins of a feature, ascending, at most `most_bins - 1` numbers.

    column, sample_weight: (n,); values that are missing, NaN, and those without weight do not count. Few values are
    parted in the middle between them, many where their weights are cut into `most_bins` equal parts.
    """
    from sklearn.ensemble._hist_gradient_boosting import binning

    if sample_weight is None:
        return _theirs()(column, most_bins)
    counts = ~np.isnan(column) & (sample_weight != 0)
    values, weight = column[counts], sample_weight[counts]
    if len(np.unique(values)) <= most_bins:
        return _theirs()(values, most_bins, weight)
    for _ in range(2):  # As they do, so that equal values come in the same order and sums are rounded alike.
        order = np.argsort(values)
        values, weight = values[order], weight[order]
    total, last = np.cumsum(weight), len(values) - 1
    wanted = np.linspace(0, 100, num=most_bins + 1)[1:-1] / 100 * total[-1]
    at = np.minimum(np.searchsorted(total, wanted), last)
    after = np.minimum(at + 1, last)
    between = total[at] - wanted <= np.finfo(np.float64).eps  # a part ends just at a value
    found = np.where(between, (values[at] + values[after]) / 2, values[at])
    return np.asarray(np.clip(np.unique(found), None, binning.ALMOST_INF))
