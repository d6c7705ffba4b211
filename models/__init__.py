"""From samples to a measured predictor: windows, predictors, training, scores, evaluation, reports, studies."""

import os
import sys
from importlib.util import find_spec

import isacsim as isacsim  # Before any library that starts threads.

MODULE = "module://"
"""What MPLBACKEND begins with where it names a module."""


def _forget_foreign_backend() -> None:
    """Let matplotlib be imported where MPLBACKEND names a module that is not installed.

    A notebook sets the variable for its own process, and its children inherit it, also those of other environments.
    """
    name = os.environ.get("MPLBACKEND", "")
    if "matplotlib" not in sys.modules and name.startswith(MODULE):
        package = name.removeprefix(MODULE).partition(".")[0]
        if find_spec(package) is None:
            del os.environ["MPLBACKEND"]


_forget_foreign_backend()
