"""The environment variables that importing isac_cosim sets, and what they do."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

VARIABLES = {"OMP_WAIT_POLICY": "passive", "THP_MEM_ALLOC_ENABLE": "1"}
MODE = Path("/sys/kernel/mm/transparent_hugepage/enabled")
HUGE_KB = """
import isac_cosim, torch
values = torch.ones(2**24)
for line in open("/proc/self/smaps_rollup"):
    if line.startswith("AnonHugePages"):
        print(line.split()[1])
"""


def output_of(code: str, **variables: str) -> str:
    environment = {key: value for key, value in os.environ.items() if key not in VARIABLES} | variables
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    return done.stdout


@pytest.mark.parametrize("name", VARIABLES)
def test_a_variable_is_set_unless_the_user_has_set_it(name: str) -> None:
    code = f"import os, isac_cosim; print(os.environ[{name!r}])"
    assert output_of(code).strip() == VARIABLES[name]
    assert output_of(code, **{name: "another"}).strip() == "another"


@pytest.mark.slow
@pytest.mark.skipif(
    not MODE.is_file() or "[madvise]" not in MODE.read_text(), reason="the system gives huge pages to all or to none"
)
def test_tensors_lie_in_huge_pages() -> None:
    tensor_kb = 4 * 2**24 // 1024
    assert int(output_of(HUGE_KB)) > 0.9 * tensor_kb
    assert int(output_of(HUGE_KB, THP_MEM_ALLOC_ENABLE="0")) < 0.1 * tensor_kb
