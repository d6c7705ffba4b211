"""A figure is the same whatever its user has told matplotlib."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import matplotlib as mpl
import pytest

from isac_cosim.evaluation.report.figures import figure

ROOT = Path(__file__).parents[3]
ABSENT = "module://no_such_package.backend_inline"
"""A backend as a notebook names it to the processes that it starts, which may belong to another environment."""


def draw(path: Path) -> None:
    with figure(path, 4.0, 3.0) as drawn:
        axes = drawn.subplots()
        axes.plot([0, 1], [0, 2], label="line")
        axes.set(xlabel="time, s", title="A figure")
        axes.legend()


@pytest.fixture
def plain(tmp_path: Path) -> bytes:
    draw(tmp_path / "plain.png")
    return (tmp_path / "plain.png").read_bytes()


def test_settings_of_the_process_have_no_part_in_it_and_hold_afterwards(tmp_path: Path, plain: bytes) -> None:
    with mpl.rc_context({"lines.linestyle": ":", "axes.facecolor": "yellow", "savefig.facecolor": "red"}):
        draw(tmp_path / "restyled.png")
        assert mpl.rcParams["axes.facecolor"] == "yellow"
    assert (tmp_path / "restyled.png").read_bytes() == plain


@pytest.mark.parametrize("backend", [ABSENT, *(pytest.param(of, marks=pytest.mark.slow) for of in ("svg", ""))])
def test_what_the_user_has_set_outside_does_not_reach_it(tmp_path: Path, plain: bytes, backend: str) -> None:
    """A matplotlibrc that asks for LaTeX, which is not installed, and a backend that is not there, or another one."""
    (tmp_path / "matplotlibrc").write_text("text.usetex: True\naxes.facecolor: yellow\n")
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "MPLCONFIGDIR": str(tmp_path), "MPLBACKEND": backend}
    code = (
        "import sys; from pathlib import Path; import isac_cosim.models.training.training; "
        "from tests.evaluation.report.test_figures import draw; draw(Path(sys.argv[1]))"
    )
    command = [sys.executable, "-c", code, str(tmp_path / "other.png")]
    subprocess.run(command, env=environment, check=True, cwd=tmp_path)
    assert (tmp_path / "other.png").read_bytes() == plain


@pytest.mark.parametrize("backend", [ABSENT, "no_such_backend"])
def test_no_command_minds_a_backend_that_is_not_there(backend: str) -> None:
    environment = {**os.environ, "MPLBACKEND": backend}
    code = "import cosim; code = cosim.main(['inspect', 'nowhere']); import matplotlib.pyplot; raise SystemExit(code)"
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr.count("\n")) == (2, 1), done.stderr
