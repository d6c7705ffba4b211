"""Versions of the installed packages that results depend on."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version

OF_DATASETS = ("isac-cosim", "libsumo", "numpy", "pyarrow", "scipy")
"""Packages whose version may change the bytes of a shard."""
OF_RUNS = ("aeon", "isac-cosim", "lightning", "numpy", "scikit-learn", "torch")
"""Packages whose version may change a trained predictor or its scores."""


def versions(packages: Sequence[str]) -> dict[str, str]:
    """Return the version of every package that is installed, by name.

    The project itself may run from its source tree without being installed.
    """
    installed = {}
    for name in packages:
        with suppress(PackageNotFoundError):
            installed[name] = version(name)
    return installed
