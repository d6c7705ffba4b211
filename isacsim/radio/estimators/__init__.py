"""Estimators of angle, delay and Doppler, by name. They know echoes and waveforms, but no sites and no vehicles.

To add an estimator, write a class that fulfils `isacsim.radio.estimation.Estimator`, and give it a line below or, in a
package of its own, an entry point of GROUP.
"""

from isacsim.radio.estimation import Estimator
from isacsim.radio.estimators.candan import Candan
from isacsim.radio.estimators.grid import Grid, PaddedGrid
from isacsim.radio.estimators.maximum_likelihood import MaximumLikelihood
from isacsim.registry import Registry

GROUP = "isac_cosim.estimators"
ESTIMATORS: Registry[Estimator] = Registry(
    "estimator",
    {
        "ml": MaximumLikelihood(),
        "candan": Candan(),
        "grid": Grid(),
        "padded_grid": PaddedGrid(),
    },
    GROUP,
)
