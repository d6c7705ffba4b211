"""All predictors that are trained on streams, by name."""

from __future__ import annotations

from collections.abc import Mapping

from isac_cosim.base.registry import Registry
from isac_cosim.models.hazards.causal import CausalPredictor
from isac_cosim.models.hazards.mixtures import GaussianMixtures
from isac_cosim.models.hazards.predictor import HazardPredictor
from isac_cosim.models.hazards.trees import SituationTrees, StreamTrees
from isac_cosim.models.hazards.window_networks import AsiBipOnStreams, CastformerOnStreams, InceptionTimeOnStreams

GROUP = "isac_cosim.stream_predictors"
"""The entry point group through which installed packages offer predictors that are trained on streams."""
OWN: Mapping[str, type[HazardPredictor]] = {
    "trees": StreamTrees,
    "situation": SituationTrees,
    "mixtures": GaussianMixtures,
    "causal": CausalPredictor,
    "asi-bip": AsiBipOnStreams,
    "castformer": CastformerOnStreams,
    "inception-time": InceptionTimeOnStreams,
}
"""The predictors of this project that are trained on streams."""
STREAM_PREDICTORS: Registry[type[HazardPredictor]] = Registry("predictor trained on streams", OWN, GROUP)
DEFAULT, FLOOR = "trees", "situation"
"""The predictor that is trained where none is named, and the plain one that others are compared with."""
