"""What options stand for when they are absent."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

import cosim
from isac_cosim.command_line.arguments import dataset_study
from isac_cosim.command_line.options import cores

COUNT = (
    "import os; os.sched_setaffinity(0, [min(os.sched_getaffinity(0))]); "
    "from isac_cosim.command_line.options import cores; "
)


def test_cores_are_some_of_the_machine_s() -> None:
    assert 1 <= cores() <= (os.cpu_count() or 1)


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="the platform does not bind processes to cores")
def test_a_process_bound_to_one_core_uses_one() -> None:
    command = [sys.executable, "-c", f"{COUNT}print(cores())"]
    done = subprocess.run(command, cwd=Path(cosim.__file__).parent, capture_output=True, text=True, check=True)
    assert done.stdout == "1\n"


def test_natural_traffic_is_left_alone() -> None:
    assert dataset_study(["motorway"], None, None, None, natural=True).maneuvers.quiet
    assert not dataset_study(["motorway"], None, None, None).maneuvers.quiet
