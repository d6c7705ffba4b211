"""The packages that this one needs, held against the published faults that SECURITY.md lists. Needs no network."""

from __future__ import annotations

import re
import tomllib
from importlib.metadata import version
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.version import Version

import cosim

ROOT = Path(cosim.__file__).parent
ALSO = {"dask": "distributed"}
"""Packages that a requirement brings along in the same version."""


def listed() -> list[tuple[str, str, str]]:
    """Package, fault and first sound version of every row of the table."""
    lines = (ROOT / "SECURITY.md").read_text(encoding="utf-8").partition("## Packages")[2].splitlines()
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines if line.startswith("|")]
    return [(package, fault, fixed) for package, fault, _, fixed in rows if re.fullmatch(r"\d+(\.\d+)+", fixed)]


def requirements() -> dict[str, Requirement]:
    content = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    needed = {one.name: one for one in map(Requirement, content["project"]["dependencies"])}
    return needed | {other: needed[name] for name, other in ALSO.items()}


def test_the_list_is_read() -> None:
    assert {"torch", "skops", "pyarrow", "pydantic"} <= {package for package, _, _ in listed()}
    assert len(listed()) >= 10


@pytest.mark.parametrize(("package", "fault", "fixed"), listed(), ids=lambda value: value)
def test_no_version_with_the_fault_is_allowed_or_installed(package: str, fault: str, fixed: str) -> None:
    floors = [Version(one.version) for one in requirements()[package].specifier if one.operator == ">="]
    assert max(floors) >= Version(fixed)
    assert Version(version(package)) >= Version(fixed)
