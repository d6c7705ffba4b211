"""The time to draw and detect a panel's echo of many scattering points, on one thread.

60 points in twelve groups of five, as wide as vehicles, with the numerology `nr100`. The reference is the oracle that
adds up the points symbol by symbol over all cells (`benchmarks.scene_cube`).

Run: python -m isac_cosim.benchmarks.scene
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from isac_cosim.base.arrays import Array
from isac_cosim.base.files import json_text
from isac_cosim.benchmarks.ratios import Ratio
from isac_cosim.benchmarks.scene_cube import cube
from isac_cosim.isacsim.scene.cells import CellGrid, Echoes, draw
from isac_cosim.isacsim.scene.detection import detect
from isac_cosim.isacsim.scene.settings import NUMEROLOGIES

GROUPS, POINTS, ROUNDS, DRAWS, RANGE_M, FALSE_ALARM = 12, 5, 5, 20, 350.0, 1e-3
HEIGHT_M = -14.2
"""Height of the points above the panel, m."""
RATIOS = (
    Ratio(("ratio",), "panels a second: cells around 60 points over all cells, symbol by symbol", "small arrays"),
)


def run() -> dict[str, Any]:
    """Return `ratio` (panels a second over those of the oracle) and `panel_ms`: draw, detect, and the oracle's draw."""
    grid, rng = CellGrid.of(NUMEROLOGIES["nr100"].waveform, RANGE_M), np.random.default_rng(0)
    offset, velocity = _points(rng)
    distance = np.sqrt((offset**2).sum(axis=1))
    radial = (offset[:, :2] * velocity).sum(axis=1) / distance
    amplitude = np.exp(2j * np.pi * rng.random(len(offset)))
    echoes = Echoes(np.stack([offset[:, 0] / distance, distance, radial], axis=1), amplitude)
    right = np.array([1.0, 0.0])
    drawn = draw(echoes, grid, rng)
    ways: dict[str, tuple[Callable[[], object], int]] = {
        "draw": (lambda: draw(echoes, grid, rng), DRAWS),
        "detect": (lambda: detect(drawn, grid, FALSE_ALARM, rng), DRAWS),
        "oracle": (lambda: cube(offset, velocity, right, amplitude, grid, rng), 1),
    }
    # The ways take turns, so that other load on the machine slows all of them.
    rounds = [{name: _milliseconds(*way) for name, way in ways.items()} for _ in range(ROUNDS)]
    ratios = [of["oracle"] / (of["draw"] + of["detect"]) for of in rounds]
    return {
        "ratio": round(float(np.median(ratios)), 1),
        "ratio_of": "milliseconds of all cells, symbol by symbol, over drawing and detecting those around the points",
        "panel_ms": {name: round(float(np.median([of[name] for of in rounds])), 3) for name in ways},
        "settings": {"points": GROUPS * POINTS, "cells": grid.size, "rounds": ROUNDS},
    }


def _points(rng: np.random.Generator) -> tuple[Array, Array]:
    """Return points in groups in front of a panel that faces +y: offsets, m, (Q, 3), and velocities, m/s, (Q, 2)."""
    ahead = np.repeat(np.linspace(40.0, 320.0, GROUPS), POINTS)
    aside = np.repeat(rng.uniform(-0.6, 0.6, GROUPS), POINTS) * ahead
    offset = np.stack([aside, ahead, np.full(len(ahead), HEIGHT_M)], axis=1)
    offset[:, :2] += rng.normal(0.0, 2.0, (len(offset), 2))
    velocity = np.repeat(rng.uniform(-35.0, 35.0, (GROUPS, 1)), POINTS, axis=0) * np.array([0.6, 0.8])
    return offset, velocity


def _milliseconds(way: Callable[[], object], times: int) -> float:
    """Return the processor time of a call, ms: what else runs on the machine counts less."""
    begin = time.process_time()
    for _ in range(times):
        way()
    return 1000 * (time.process_time() - begin) / times


if __name__ == "__main__":
    print(json_text(run(), 2))
