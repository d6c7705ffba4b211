"""Benchmarks: the measurements behind the claims about speed and size.

In comes the name of a benchmark; out come its ratios, and the table of all of them.

A speed is a ratio, and both of its sides are measured in the same run. Nothing else imports this package, apart from
`cosim bench`.
"""

import importlib
from typing import Any

from isac_cosim.base.errors import InputError
from isac_cosim.base.feedback import SILENT, Feedback
from isac_cosim.base.registry import Registry
from isac_cosim.benchmarks.ratios import as_json, machine, rows

NAMES = ("echo", "traffic", "generate", "train", "infer", "scene", "live")
BENCHES = Registry("bench", {name: f"isac_cosim.benchmarks.{name}" for name in NAMES})
"""Modules with a function `run` and the ratios that sum its result up, `RATIOS`, by the name `cosim bench` takes."""


def run(name: str) -> dict[str, Any]:
    """Run a benchmark and return its result. Raises InputError if there is none of that name."""
    result: dict[str, Any] = importlib.import_module(BENCHES[name]).run()
    return result


def run_all(feedback: Feedback = SILENT) -> dict[str, Any]:
    """Run every benchmark, one after the other.

    Returns `machine`, `table` (a row a ratio: `bench`, `ratio`, `measures`, `bound_by`) and `results`, each
    benchmark's own result by its name.
    """
    results: dict[str, Any] = {}
    table = []
    with feedback.bar("measuring") as move:
        for done, name in enumerate(BENCHES):
            move(done, len(BENCHES), name)
            results[name] = run(name)
            table += rows(name, importlib.import_module(BENCHES[name]).RATIOS, results[name])
        move(len(BENCHES), len(BENCHES), "")
    return {"machine": machine(), "table": as_json(table), "results": results}


def check_choice(name: str | None, every: bool) -> None:
    """Raise InputError unless either one benchmark or all of them are chosen."""
    if (name is None) != every:
        raise InputError(f"give either the name of a benchmark ({', '.join(BENCHES)}) or --all")
