"""Each bundled scenario is what its build script makes."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from isacsim.scenarios.scenario import bundled


@pytest.mark.parametrize("name", sorted(bundled()))
def test_a_bundled_scenario_is_what_its_script_builds(name: str, tmp_path: Path) -> None:
    stands = bundled()[name]
    (folder := tmp_path / name).mkdir()
    shutil.copy(stands / "build.py", folder)
    subprocess.run([sys.executable, folder / "build.py"], check=True, capture_output=True, cwd=stands.parents[1])
    made = {path.name for path in folder.iterdir()}
    assert made == {path.name for path in stands.iterdir() if path.is_file()} - {"README.md"}
    for file in made:
        assert (folder / file).read_bytes() == (stands / file).read_bytes(), file
