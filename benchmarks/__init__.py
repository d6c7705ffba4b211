"""Benchmarks: the measurements behind the claims about speed and size.

A speed is a ratio, and both of its sides are measured in the same run. Nothing else imports this package, apart from
`cosim bench`.
"""

import importlib
from typing import Any

from isacsim.errors import InputError

NAMES = ("echo", "traffic", "generate", "train", "infer")


def run(name: str) -> dict[str, Any]:
    """Run a benchmark and return its result. Raises InputError if there is none of that name."""
    if name not in NAMES:
        raise InputError(f"bench {name}: there is none of that name; choose one of {', '.join(NAMES)}")
    result: dict[str, Any] = importlib.import_module(f"benchmarks.{name}").run()
    return result
