"""The SUMO that simulates: the one that is installed with the tool, and no other."""

from __future__ import annotations

import os
from contextlib import suppress
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from types import ModuleType
from typing import Any

from isac_cosim.base.errors import InputError

NEEDED = "1.28"
"""The release of SUMO that the tool is made for."""


@cache
def load_libsumo() -> Any:
    """Return the libsumo module. Imports it, which takes a second, and sets SUMO_HOME to the package's own.

    Raises InputError where another SUMO would answer than the one that results name as their version: it is found
    first where `PYTHONPATH` leads to one.
    """
    import sumo

    os.environ["SUMO_HOME"] = sumo.SUMO_HOME
    import libsumo
    import sumolib

    check_version("libsumo", libsumo, libsumo.getVersion()[1].removeprefix("SUMO "))
    check_version("sumolib", sumolib, sumolib.__version__)
    return libsumo


def check_version(package: str, module: ModuleType, answers: str) -> None:
    """Raise InputError where a module is not of the installed package, or not of the release that is needed.

    package: its name. answers: the version that the module itself says it has.
    """
    where = Path(str(module.__file__)).parent
    if not f"{answers}.".startswith(f"{NEEDED}."):
        raise InputError(f"{where}: is {package} {answers}, but SUMO {NEEDED} is needed; {_fix(where)}")
    with suppress(PackageNotFoundError):  # an installation without metadata has no version to disagree with
        installed = version(package)
        if installed != answers:
            raise InputError(f"{where}: is {package} {answers}, but {installed} is installed; {_fix(where)}")


def _fix(where: Path) -> str:
    return f"take {where.parent} out of PYTHONPATH, or install the tool anew"
