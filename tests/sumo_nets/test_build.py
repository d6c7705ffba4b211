"""The files of each bundled scenario are those that its build script makes."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from isac_cosim.isacsim.scenarios.scenario import bundled


@pytest.mark.parametrize("name", sorted(bundled()))
def test_a_bundled_scenario_is_what_its_script_builds(name: str, tmp_path: Path) -> None:
    bundled_folder = bundled()[name]
    (folder := tmp_path / name).mkdir()
    shutil.copy(bundled_folder / "build.py", folder)
    subprocess.run(
        [sys.executable, folder / "build.py"], check=True, capture_output=True, cwd=bundled_folder.parents[1]
    )
    built = {path.name for path in folder.iterdir()}
    assert built == {path.name for path in bundled_folder.iterdir() if path.is_file()} - {"README.md"}
    for file in built:
        assert (folder / file).read_bytes() == (bundled_folder / file).read_bytes(), file
