"""Trust the site that measures range best, and ignore the others."""

import numpy as np

from isac_cosim.isacsim.tracking.fusion import fuse


def best_site(measured, deviation, used, panels, settings):
    range_deviation = np.where(used, deviation[..., 1], np.inf)
    best = np.zeros_like(used)
    best[np.arange(len(used)), range_deviation.argmin(axis=1)] = True
    return fuse(measured, deviation, used & best, panels, settings)
