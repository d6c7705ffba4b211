"""Which ratios of the benchmarks sum them up, and the table of all of them."""

from __future__ import annotations

import os
import platform
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import psutil
from rich.console import Console

from isac_cosim.base.progress import print_line
from isac_cosim.base.versions import versions
from isac_cosim.evaluation.report.parts import markdown

PACKAGES = ("isac-cosim", "libsumo", "lightning", "numpy", "torch")
"""Packages that the speeds depend on most."""


@dataclass(frozen=True)
class Ratio:
    """One ratio in the result of a benchmark.

    path: the keys that lead to it in the result. measures: what over what. bound_by: what limits the faster side.
    """

    path: tuple[str, ...]
    measures: str
    bound_by: str

    def of(self, result: dict[str, Any]) -> float:
        """Return the ratio in a result."""
        value: Any = result
        for key in self.path:
            value = value[key]
        return float(value)


@dataclass(frozen=True)
class Row:
    """A row of the table: the benchmark, the ratio in it, and what it means."""

    bench: str
    ratio: float
    measures: str
    bound_by: str


def rows(bench: str, ratios: Sequence[Ratio], result: dict[str, Any]) -> list[Row]:
    """Return the rows of one benchmark."""
    return [Row(bench, round(ratio.of(result), 3), ratio.measures, ratio.bound_by) for ratio in ratios]


def machine() -> dict[str, Any]:
    """Return what the speeds were measured on: processor, cores available, memory in GiB, system and versions."""
    return {
        "processor": _processor(),
        "cores": os.cpu_count(),
        "memory_gib": round(psutil.virtual_memory().total / 2**30),
        "system": f"{platform.system()} {platform.machine()}, Python {platform.python_version()}",
        "versions": versions(PACKAGES),
    }


def as_markdown(table: Sequence[Row], measured_on: dict[str, Any]) -> str:
    """Return the table for docs/performance.md."""
    packages = ", ".join(f"{name} {version}" for name, version in measured_on["versions"].items())
    head = (
        f"{measured_on['processor']}, {measured_on['cores']} cores, {measured_on['memory_gib']} GiB; "
        f"{measured_on['system']}; {packages}"
    )
    cells = [[f"`{row.bench}`", f"{row.ratio:g}", row.measures, row.bound_by] for row in table]
    return f"{head}\n\n{markdown(['bench', 'ratio', 'of what', 'bound by'], cells)}"


def as_json(table: Sequence[Row]) -> list[dict[str, Any]]:
    """Return the table as plain values."""
    return [asdict(row) for row in table]


def _processor() -> str:
    """Return the processor's name, as far as the system tells it."""
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.exists():
        for line in cpuinfo.read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


def show_bench(result: dict[str, Any], console: Console) -> None:
    """Show the result of one benchmark, or the table of all of them."""
    if "table" not in result:
        console.print_json(data=result)
        return

    print_line(console, as_markdown([Row(**row) for row in result["table"]], result["machine"]))
