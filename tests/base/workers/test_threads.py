"""Numerical libraries use the threads that they are told to, also where torch is imported only then."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

import cosim

SHOWN = """
import os, sys
{before}
from isac_cosim.base.workers.threads import limited
assert ("torch" in sys.modules) == ("torch" in {before!r})
with limited(1):
    with limited(3):
        import torch
        from threadpoolctl import threadpool_info
        print(torch.get_num_threads(), {{library["num_threads"] for library in threadpool_info()}})
    print(torch.get_num_threads())
left = {{library["num_threads"] for library in threadpool_info()}}
print(torch.get_num_threads(), os.environ.get("OMP_NUM_THREADS"), 3 in left)
"""


@pytest.mark.parametrize(
    "before", ["", *(pytest.param(f"import {of}", marks=pytest.mark.slow) for of in ("torch", "sklearn.ensemble"))]
)
def test_torch_keeps_to_the_limit_whenever_it_is_imported(before: str) -> None:
    """And afterwards to what the user told it."""
    done = subprocess.run(
        [sys.executable, "-c", SHOWN.format(before=before)],
        env={**os.environ, "OMP_NUM_THREADS": "2"}, cwd=Path(cosim.__file__).parent,
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert done.stdout.splitlines() == ["3 {3}", "1", "2 2 False"]


def test_what_generates_needs_neither_torch_nor_pandas() -> None:
    """Every worker process would take longer to start than everything else that it imports."""
    code = (
        "import sys, isac_cosim.labeling.generation.generate, isac_cosim.labeling.streams.generate; "
        "print(sorted({'torch', 'pandas', 'sklearn', 'matplotlib', 'scipy.optimize'} & set(sys.modules)))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=Path(cosim.__file__).parent, capture_output=True, text=True, check=True
    )
    assert done.stdout == "[]\n"
