"""A trained network as one file that runs without this tool: torch's exported program (`.pt2`).

The program takes windows in the run's frame of reference, tv (n, 6, T) and uv (n, 6, U) float32, for any n, and answers
with logits (n, G) and features (n, F). `models.data.windows.in_frame` changes the frame; divide logits by the
temperature of `run.json` for calibrated probabilities. Tracing an LSTM over a long window takes a minute.
"""

from __future__ import annotations

import warnings
from pathlib import Path

import torch
from torch import Tensor, nn
from torch.export import Dim, ExportedProgram

from isacsim.errors import InputError
from isacsim.files import replace_file
from models.predictors.network import N_STATES, WindowNetwork
from models.run import NetworkPredictor, Run

SUFFIX = ".pt2"


class Answering(nn.Module):
    """A network that answers with logits and with the features behind them."""

    def __init__(self, network: WindowNetwork) -> None:
        super().__init__()
        self.network = network

    def forward(self, tv: Tensor, uv: Tensor) -> tuple[Tensor, Tensor]:
        features = self.network.features(tv, uv)
        return self.network.classify(features), features


def export(run: Run) -> ExportedProgram:
    """The network of a run as an exported program. InputError where the run is no single network."""
    if not isinstance(run.predictor, NetworkPredictor):
        raise InputError(f"{run.path}: {run.name} is no single network; export a run of asi-bip, castformer or aligned")
    shapes = [(2, N_STATES, run.card.tv_length), (2, N_STATES, run.card.uv_length)]
    count = Dim("n")
    with warnings.catch_warnings():
        # LSTMs reassign their list of weights while they are traced; the program has the weights all the same.
        warnings.filterwarnings("ignore", message="The tensor attributes? .* assigned during export")
        return torch.export.export(
            Answering(run.predictor.network).eval(),
            tuple(torch.zeros(shape) for shape in shapes),
            dynamic_shapes=({0: count}, {0: count}),
        )


def write_export(run: Run, out: str | Path) -> Path:
    """Write `export` of a run to a file. InputError as for `export`, or where its name does not end in .pt2."""
    path = Path(out)
    if path.suffix != SUFFIX:
        raise InputError(f"{path}: an exported program ends in {SUFFIX}; name it so")
    program = export(run)
    replace_file(path, lambda partial: torch.export.save(program, partial))
    return path
