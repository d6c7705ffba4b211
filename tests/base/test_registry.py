"""Implementations by name, those of other packages among them."""

from __future__ import annotations

from pathlib import Path

import pytest

from isac_cosim.base.errors import InputError
from isac_cosim.base.registry import Registry

BY_PACKAGE = "[isac_cosim.test_shapes]\nhexagon = shapes_package:SIDES\nbroken = no_such_module:nothing\n"


def shapes(group: str | None = None) -> Registry[int]:
    return Registry("shape", {"triangle": 3, "square": 4}, group)


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A package that offers shapes, importable and with metadata."""
    (tmp_path / "shapes_package.py").write_text("SIDES = 6\n")
    metadata = tmp_path / "shapes_package-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: shapes-package\nVersion: 1.0\n")
    (metadata / "entry_points.txt").write_text(BY_PACKAGE)
    monkeypatch.syspath_prepend(tmp_path)


def test_names_come_in_order_and_items_by_name() -> None:
    assert list(shapes()) == ["triangle", "square"]
    assert shapes()["square"] == 4


def test_an_unknown_name_suggests_the_nearest() -> None:
    with pytest.raises(
        InputError, match=r"unknown shape 'sqare': did you mean square\? choose one of triangle, square"
    ):
        shapes()["sqare"]
    with pytest.raises(ValueError, match="did you mean triangle"):
        shapes().check("triangel")
    assert shapes().check("triangle") == "triangle"


@pytest.mark.usefixtures("installed")
def test_installed_packages_offer_more() -> None:
    registry = shapes("isac_cosim.test_shapes")
    assert list(registry) == ["triangle", "square", "broken", "hexagon"]
    assert len(registry) == 4
    assert registry["hexagon"] == 6
    assert "hexagon" not in shapes()


@pytest.mark.usefixtures("installed")
def test_a_package_that_cannot_be_imported_is_reported_in_one_line() -> None:
    with pytest.raises(InputError, match=r"shape broken: package shapes-package cannot be imported \(No module named"):
        shapes("isac_cosim.test_shapes")["broken"]
