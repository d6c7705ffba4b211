"""Benchmarks: the measurements behind the claims about speed and size.

A speed is a ratio, and both of its sides are measured in the same run. Nothing else imports this package, apart from
`cosim bench`.
"""

import importlib
from typing import Any

from isacsim.registry import Registry

BENCHES = Registry(
    "bench",
    {name: f"benchmarks.{name}" for name in ("echo", "traffic", "generate", "train", "infer", "live")},
)
"""Modules with a function `run`, by the name that `cosim bench` takes."""


def run(name: str) -> dict[str, Any]:
    """Run a benchmark and return its result. Raises InputError if there is none of that name."""
    result: dict[str, Any] = importlib.import_module(BENCHES[name]).run()
    return result
