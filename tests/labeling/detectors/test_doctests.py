"""The examples in the docstrings run, and every detector has one."""

from __future__ import annotations

import doctest
from importlib import import_module

import pytest

from isac_cosim.labeling.detectors.registry import DETECTORS

MODULES = sorted({detector.__module__ for detector in DETECTORS.values()})


@pytest.mark.parametrize(
    "module", [*MODULES, "isac_cosim.labeling.detectors.threshold_crossings", "isac_cosim.labeling.road.straight_road"]
)
def test_the_examples_of_a_module_run(module: str) -> None:
    result = doctest.testmod(import_module(module))
    assert result.attempted > 0
    assert result.failed == 0


@pytest.mark.parametrize("name", list(DETECTORS))
def test_every_detector_says_what_it_finds_and_shows_it(name: str) -> None:
    """The definition of the three times and of the peak, where it fails, and an example that detects an event."""
    text = DETECTORS[name].__doc__ or ""
    for part in ("onset", "commit", "end:", "peak", "Fails where", ".detect("):
        assert part in text
    assert text.count(">>>") >= 3
