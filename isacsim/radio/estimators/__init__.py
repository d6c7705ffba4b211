"""Estimators of angle, delay and Doppler, by name. They know echoes and waveforms, but no sites and no vehicles.

In come echoes, whole or as cells of their DFT; out come estimates in cells.

To add an estimator, write a class that fulfils `isacsim.radio.estimation.Estimator`, and give it a line below or, in a
package of its own, an entry point of GROUP.
"""

from isac_cosim.base.registry import Registry
from isac_cosim.isacsim.radio.estimation import Estimator
from isac_cosim.isacsim.radio.estimators.candan import Candan
from isac_cosim.isacsim.radio.estimators.grid import Grid, PaddedGrid, PaddedParabola
from isac_cosim.isacsim.radio.estimators.maximum_likelihood import MaximumLikelihood

GROUP = "isac_cosim.estimators"
ESTIMATORS: Registry[Estimator] = Registry(
    "estimator",
    {
        "ml": MaximumLikelihood(),
        "candan": Candan(),
        "grid": Grid(),
        "padded_grid": PaddedGrid(),
        "padded_parabola": PaddedParabola(),
    },
    GROUP,
)
