"""Versions of the packages that results depend on."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version

OF_DATASETS = ("isac-cosim", "libsumo", "numpy", "pyarrow", "scipy")
"""Packages whose version can change the bytes of a shard."""
OF_RUNS = ("aeon", "isac-cosim", "lightning", "numpy", "scikit-learn", "torch")
"""Packages whose version can change a trained predictor or its scores."""

OF_EPISODES = (*OF_RUNS, "libsumo", "scipy")
"""Packages whose version can change what an evaluation in traffic sees and answers."""


def versions(packages: Sequence[str]) -> dict[str, str]:
    """Return the versions of the named packages, by name, leaving out those that are not installed.

    This project itself is missing when it runs from its source tree.
    """
    installed = {}
    for name in packages:
        with suppress(PackageNotFoundError):
            installed[name] = version(name)
    return installed
