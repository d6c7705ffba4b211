"""Maximum likelihood, reported on a codebook of an eighth of a cell."""

import numpy as np

from isac_cosim.isacsim.radio.estimation import Estimates
from isac_cosim.isacsim.radio.estimators.maximum_likelihood import MaximumLikelihood

STEP = 1 / 8


class Codebook:
    label, exact = "codebook", MaximumLikelihood()

    def observe(self, cells, snr, waveform, rng):
        estimates = self.exact.observe(cells, snr, waveform, rng)
        return Estimates(np.round(estimates.cells / STEP) * STEP, estimates.power)

    def estimate(self, echo):
        cells, power = self.exact.estimate(echo)
        return (cells / STEP).round() * STEP, power

    def deviation(self, power, waveform):
        return np.hypot(self.exact.deviation(power, waveform), STEP / np.sqrt(12))


ESTIMATOR = Codebook()
