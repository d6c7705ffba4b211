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
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from isac_cosim.labeling.dataset.dataset import Dataset
    from isac_cosim.models.inference import Infer

_HERE = Path(__file__).resolve().parent
if not (_HERE / "isacsim").is_dir():
    __path__.append(str(_HERE.parent))

os.environ.setdefault("OMP_WAIT_POLICY", "passive")
os.environ.setdefault("THP_MEM_ALLOC_ENABLE", "1")
_KIND, _, _BACKEND = os.environ.get("MPLBACKEND", "").partition("://")
if _KIND == "module" and "matplotlib" not in sys.modules and find_spec(_BACKEND.partition(".")[0]) is None:
    del os.environ["MPLBACKEND"]


def open(dataset: str | Path) -> Dataset:
    """Open a dataset, the folder that `cosim generate` wrote. Raises InputError if it is none, or damaged."""
    from isac_cosim.labeling.dataset.dataset import Dataset

    return Dataset.open(dataset)


def load(run: str | Path) -> Infer:
    """Load a trained predictor, the folder that `cosim train` wrote, to ask it about windows.

    Raises InputError if it is none, or damaged.
    """
    from isac_cosim.models.inference import Infer

    return Infer.load(run)
