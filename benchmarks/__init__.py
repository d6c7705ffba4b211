"""What the speed claims rest on: each benchmark measures both sides of a ratio in one run."""

import importlib
from typing import Any

from isacsim.errors import InputError

NAMES = ("echo", "traffic", "generate", "train", "infer")


def run(name: str) -> dict[str, Any]:
    """The result of a benchmark. Raises InputError where there is none of that name."""
    if name not in NAMES:
        raise InputError(f"bench {name}: there is none of that name; choose one of {', '.join(NAMES)}")
    found: dict[str, Any] = importlib.import_module(f"benchmarks.{name}").run()
    return found
