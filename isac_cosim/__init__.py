"""The one import name of the tool: `isac_cosim.models`, `isac_cosim.labeling` and so on.

An installed wheel has the packages inside this folder; a checkout has them beside it.

Importing it sets two environment variables, each of which a library reads once, so it comes before the first import of
torch or scikit-learn. Values that the user has set are kept. docs/performance.md says what both are worth.

- Idle OpenMP threads sleep instead of spin. A spinning team of two threads on two cores makes training several times
  slower as soon as anything else runs.
- PyTorch asks for huge pages. A training step allocates a hundred megabytes anew, and a page fault for every 4 kB of
  them takes a fifth of its time.

It also forgets an MPLBACKEND that names a module which is not installed: a notebook sets the variable for its own
process, its children inherit it, also those of other environments, and matplotlib then refuses to be imported.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from isac_cosim.classifier import IntentionClassifier as IntentionClassifier
    from isac_cosim.evaluation.on_windows.results import EvaluationResult
    from isac_cosim.evaluation.on_windows.settings import EvaluateSettings as EvaluateSettings
    from isac_cosim.labeling.dataset.dataset import Dataset
    from isac_cosim.measuring import Asked
    from isac_cosim.models.inference import Infer
    from isac_cosim.models.runs.run import Run
    from isac_cosim.models.runs.settings import TrainSettings as TrainSettings
    from isac_cosim.opened import OpenedDataset

_HERE = Path(__file__).resolve().parent
if not (_HERE / "isacsim").is_dir():
    __path__.append(str(_HERE.parent))

os.environ.setdefault("OMP_WAIT_POLICY", "passive")
os.environ.setdefault("THP_MEM_ALLOC_ENABLE", "1")
_KIND, _, _BACKEND = os.environ.get("MPLBACKEND", "").partition("://")
if _KIND == "module" and "matplotlib" not in sys.modules and find_spec(_BACKEND.partition(".")[0]) is None:
    del os.environ["MPLBACKEND"]


_LATER = {
    "IntentionClassifier": "isac_cosim.classifier",
    "EvaluateSettings": "isac_cosim.evaluation.on_windows.settings",
    "TrainSettings": "isac_cosim.models.runs.settings",
}
"""Classes that are imported from their modules when somebody asks for them."""


def __getattr__(name: str) -> Any:
    if name in _LATER:
        return getattr(import_module(_LATER[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*globals(), *_LATER])


def open(dataset: str | Path) -> OpenedDataset:
    """Open a dataset, the folder that `cosim generate` wrote. Raises InputError if it is none, or damaged."""
    from isac_cosim.opened import OpenedDataset

    return OpenedDataset.open(dataset)


def load(run: str | Path) -> Infer:
    """Load a trained predictor, the folder that `cosim train` wrote, to ask it about windows.

    Raises InputError if it is none, or damaged.
    """
    from isac_cosim.models.inference import Infer

    return Infer.load(run)


def evaluate(
    asked: Asked,
    dataset: Dataset,
    out: str | Path | None = None,
    settings: EvaluateSettings | None = None,
    against: Sequence[str | Path | Run | Infer] = (),
    training: TrainSettings | None = None,
) -> EvaluationResult:
    """Measure a predictor on the seeds of a dataset that it has not seen, as `cosim evaluate` does.

    asked: a trained run or its folder, a fitted `IntentionClassifier`, or any function that takes windows, tv
    (n, 6, T) and uv (n, 6, U), and returns probabilities (n, 6) of the intentions in the order of their labels; or
    `models.predictors.protocol.Outputs`, if it has features. out: folder for `metrics.json` and `predictions.parquet`;
    without it, nothing is written. against: runs to compare with on the same windows. training: of a function, the
    settings of its windows and of the split: it is measured on the test side, and its temperature and open-set score
    are chosen on the validation side. By default they are those of `cosim train`.

    Returns what `metrics.json` holds. Raises InputError where no unseen seed is left, a function does not answer with
    probabilities, or `out` holds something else.
    """
    from isac_cosim import measuring

    return measuring.evaluate(asked, dataset, out, settings, against, training)
