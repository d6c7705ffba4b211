"""The examples in docstrings give what they say."""

import doctest
import importlib

import pytest


@pytest.mark.parametrize("name", ["radio.channel", "radio.cross_section", "radio.waveform", "scenarios.sumo_schemas"])
def test_examples(name: str) -> None:
    results = doctest.testmod(importlib.import_module(f"isac_cosim.isacsim.{name}"))
    assert results.attempted > 0
    assert results.failed == 0
