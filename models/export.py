"""A trained network as one file that runs without this project: torch's exported program (`.pt2`).

The program takes windows in the run's frame of reference, tv (n, 6, T) and uv (n, 6, U) float32, for any n, and returns
logits (n, G) and features (n, F). `models.data.windows.in_frame` changes the frame; divide the logits by the
temperature of `run.json` for calibrated probabilities. Tracing an LSTM over a long window takes a minute.
"""

from __future__ import annotations

import warnings
from copy import deepcopy
from pathlib import Path

import torch
from torch import Tensor, nn
from torch.export import Dim, ExportedProgram

from isacsim.errors import InputError
from isacsim.files import replace_file
from models.networks.network import N_STATES, WindowNetwork
from models.predictors.network_predictor import NetworkPredictor
from models.predictors.registry import OWN
from models.run import Run

SUFFIX = ".pt2"


class WithFeatures(nn.Module):
    """A network that returns the features beside the logits."""

    def __init__(self, network: WindowNetwork) -> None:
        super().__init__()
        self.network = network

    def forward(self, tv: Tensor, uv: Tensor) -> tuple[Tensor, Tensor]:
        """Return logits (n, G) and features (n, F) of windows (n, 6, T) and (n, 6, U)."""
        features = self.network.features(tv, uv)
        return self.network.classify(features), features


def export(run: Run) -> ExportedProgram:
    """Return the network of a run as an exported program. Raises InputError if the run is not a single network."""
    if not isinstance(run.predictor, NetworkPredictor):
        networks = ", ".join(name for name, kind in OWN.items() if kind.is_network)
        raise InputError(f"{run.path}: {run.name} is not a single network; export a run of one of {networks}")
    shapes = [(2, N_STATES, run.card.tv_length), (2, N_STATES, run.card.uv_length)]
    count = Dim("n")
    with warnings.catch_warnings():
        # LSTMs reassign their list of weights while they are traced; the program holds the weights nevertheless.
        warnings.filterwarnings("ignore", message="The tensor attributes? .* assigned during export")
        return torch.export.export(
            WithFeatures(deepcopy(run.predictor.network).cpu()).eval(),
            tuple(torch.zeros(shape) for shape in shapes),
            dynamic_shapes=({0: count}, {0: count}),
        )


def write_export(run: Run, out: str | Path) -> Path:
    """Write `export` of a run to a file. Raises InputError as `export` does, or if the name does not end in .pt2."""
    path = Path(out)
    if path.suffix != SUFFIX:
        raise InputError(f"{path}: an exported program needs a name that ends in {SUFFIX}; rename it")
    program = export(run)
    replace_file(path, lambda partial: torch.export.save(program, partial))
    return path
