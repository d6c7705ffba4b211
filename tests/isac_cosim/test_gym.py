"""The documented lines that make an environment run in a fresh process, of a checkout and of an installed wheel."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import cosim
from isac_cosim.models.runs.run import Run

ROOT = Path(cosim.__file__).parent
PAGE = (ROOT / "docs" / "closed_loop.md").read_text(encoding="utf-8")


def documented() -> str:
    """The block of docs/closed_loop.md that makes an environment, and what it ends with."""
    section = PAGE[PAGE.index("## As an environment") :]
    block = re.search(r"^```python\n(.*?)^```", section, re.MULTILINE | re.DOTALL)
    assert block
    return (
        f"{block[1]}\nimport isac_cosim.evaluation\nprint(isac_cosim.evaluation.__file__)"
        "\nprint(observation in env.observation_space, reward <= 0.0, frame.shape, frame.dtype)\n"
    )


@pytest.fixture
def folder(trees_run: Run, tmp_path: Path) -> Path:
    """A folder in which the documented predictor lies, beside packages of the same names as those of the project."""
    (tmp_path / "floor").symlink_to(trees_run.path)
    (tmp_path / "models.py").write_text("raise SystemExit('the models of another project')")
    return tmp_path


def run(code: str, folder: Path, packages: Path) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "PYTHONPATH": str(packages), "OMP_NUM_THREADS": "1"}
    return subprocess.run([sys.executable, "-c", code], cwd=folder, env=environment, capture_output=True, text=True)


def run_documented(folder: Path, packages: Path) -> Path:
    """Run the documented lines; returns where they found the project."""
    done = run(documented(), folder, packages)
    assert done.returncode == 0, done.stderr
    assert "Warning" not in done.stderr
    place, shown = done.stdout.splitlines()
    assert shown == "True True (540, 960, 3) uint8"
    return Path(place)


def test_the_documented_lines_run_in_a_fresh_process(folder: Path) -> None:
    assert run_documented(folder, ROOT) == ROOT / "evaluation" / "__init__.py"


@pytest.mark.slow
def test_the_documented_lines_run_from_an_installed_wheel(
    folder: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    site = tmp_path_factory.mktemp("site")
    install = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-compile", "--target", site, ROOT]
    subprocess.run(install, check=True)
    assert run_documented(folder, site) == site / "isac_cosim" / "evaluation" / "__init__.py"


IMPORTED = """
import sys
import isac_cosim.gym
from gymnasium import spec
print(spec(isac_cosim.gym.ENVIRONMENT).id)
print(sorted({"torch", "libsumo", "matplotlib", "pandas"} & {*sys.modules}))
"""


def test_importing_it_registers_the_environment_and_imports_nothing_more(tmp_path: Path) -> None:
    done = run(IMPORTED, tmp_path, ROOT)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == ["isac_cosim/Advisory-v0", "[]"]


def test_without_gymnasium_the_error_says_how_to_get_it(tmp_path: Path) -> None:
    done = run("import sys; sys.modules['gymnasium'] = None; import isac_cosim.gym", tmp_path, ROOT)
    last = done.stderr.splitlines()[-1]
    assert last == "ModuleNotFoundError: isac_cosim.gym needs Gymnasium: run `pip install '.[gym]'` in a checkout"


def test_no_hint_installs_from_an_index() -> None:
    """The project is on none: an extra is installed from a checkout."""
    folders = [folder for folder in ROOT.iterdir() if folder.is_dir() and not folder.name.startswith(".")]
    texts = [
        *ROOT.glob("*.*"),
        *(path for folder in folders for path in folder.rglob("*") if path.suffix in (".py", ".md")),
    ]
    assert len(texts) > 100
    wrong = "isac-cosim" + "["
    assert [path.name for path in texts if path.is_file() and wrong in path.read_text(errors="replace")] == []
