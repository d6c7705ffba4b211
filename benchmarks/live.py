"""Measures how much faster than real time vehicles are sensed, tracked and predicted on one core.

Ten vehicles drive behind ten others on a straight road with masts on both sides; each is sensed by two to four panels
at 400 Hz and predicted ten times a second, by boosted trees on windows, or by a causal network that takes one step a
decision. Traffic and its conditioning are not counted: the real world needs no simulation. The time of the rule of the
road is reported beside those.

Run: python -m isac_cosim.benchmarks.live
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from sklearn.ensemble import HistGradientBoostingClassifier

from isac_cosim.base.arrays import Array
from isac_cosim.base.files import json_text
from isac_cosim.base.workers.threads import torch_threads
from isac_cosim.benchmarks.ratios import Ratio
from isac_cosim.evaluation.in_traffic.streams.predictions import (
    WindowCutter,
    lanes_of,
    rule_answer,
)
from isac_cosim.isacsim.scenarios.scenario import Scenario, Site
from isac_cosim.labeling.generation.settings import DatasetStudy
from isac_cosim.labeling.generation.watching import watch_episode
from isac_cosim.labeling.intentions import KNOWN, Intention
from isac_cosim.labeling.road.straight_road import ScriptedVehicle, straight_road
from isac_cosim.labeling.road.surroundings import Surroundings
from isac_cosim.labeling.streams.reports import Reports
from isac_cosim.labeling.streams.sensed import SensedStretch, StretchSensing
from isac_cosim.labeling.streams.stretches import Timing, watched
from isac_cosim.models.data.lane_map import LaneMap
from isac_cosim.models.data.windows import OnMap, Windows, WindowSettings, in_frame
from isac_cosim.models.hazards.answers import WITH_HAZARD
from isac_cosim.models.hazards.causal import CausalPredictor
from isac_cosim.models.hazards.predictor import HazardFacts
from isac_cosim.models.hazards.settings import StreamFitSettings
from isac_cosim.models.predictors.protocol import WindowShape
from isac_cosim.models.predictors.trees import TreesPredictor, TreesSettings, fit_trees, tree_features
from isac_cosim.models.runs.settings import TrainSettings

VEHICLES = 10
DURATION_S = 40.0
ROUNDS = 3
RATIOS = (
    Ratio(("real_time_factor",), "simulated over processor time: ten TVs sensed and predicted", "sensing at 400 Hz"),
    Ratio(
        ("real_time_factor_causal",),
        "simulated over processor time: ten TVs sensed and predicted by a causal network",
        "sensing at 400 Hz",
    ),
)
SHAPE = WindowShape(len(KNOWN), 880, 220, 400.0, 100.0)
TIMING = Timing(
    decision_s=0.1, window_s=2.2, report_delay_s=0.02, run_in_s=0.5, margin_s=0.8, outcome_s=0.0,
    longest_stretch_s=120.0,
)  # fmt: skip


@dataclass(frozen=True)
class LiveTime:
    """Processor time by purpose, s; predicted driving, s; and the mean number of panels that sense a vehicle."""

    sensing_s: float
    cutting_s: float
    trees_s: float
    causal_s: float
    rule_s: float
    predicted_s: float
    panels: float


def run() -> dict[str, Any]:
    """Return `real_time_factor`, and the processor time for one second of one vehicle by purpose."""
    with torch_threads(1), tempfile.TemporaryDirectory() as folder:
        spent = [measured(Path(folder)) for _ in range(ROUNDS)]

    def factor(answering_s: Sequence[float]) -> float:
        parts = zip(spent, answering_s, strict=True)
        factors = [times.predicted_s / (times.sensing_s + seconds) / VEHICLES for times, seconds in parts]
        return round(float(np.median(factors)), 2)

    per_second = {
        "sensing_and_tracking": [times.sensing_s / times.predicted_s for times in spent],
        "cutting_windows": [times.cutting_s / times.predicted_s for times in spent],
        "boosted_trees": [times.trees_s / times.predicted_s for times in spent],
        "causal_network": [times.causal_s / times.predicted_s for times in spent],
        "rule": [times.rule_s / times.predicted_s for times in spent],
    }
    return {
        "real_time_factor": factor([times.cutting_s + times.trees_s for times in spent]),
        "real_time_factor_causal": factor([times.causal_s for times in spent]),
        "real_time_factor_of": f"simulated over processor time of {VEHICLES} vehicles sensed at 400 Hz and predicted "
        "ten times a second by boosted trees, one core; traffic not counted",
        "ms_per_vehicle_second": {name: round(1000 * float(np.median(s)), 2) for name, s in per_second.items()},
        "panels": round(spent[0].panels, 2),
        "settings": {"vehicles": VEHICLES, "duration_s": DURATION_S, "rounds": ROUNDS, **TIMING.__dict__},
    }


def sites() -> tuple[Site, ...]:
    """Masts every 150 m on alternating sides, each with two panels toward the road."""
    return tuple(
        Site(f"m{mast}-{azimuth}", 150.0 * mast, (-20.0, 20.0)[mast % 2], 25.0, azimuth)
        for mast in range(24)
        for azimuth in ((45.0, 315.0), (135.0, 225.0))[mast % 2]
    )


def measured(folder: Path) -> LiveTime:
    """Sense and predict the vehicles once. folder: an empty folder, for the scenario's files."""
    pairs = [
        ScriptedVehicle(f"{name}{k}", 25.0, start_m=100.0 * k + lead, duration_s=DURATION_S)
        for k in range(VEHICLES)
        for name, lead in (("tv", 0.0), ("uv", 45.0))
    ]
    recording = straight_road(*pairs)
    scenario = Scenario("straight_road", folder / "none", (), (), (0.0, 0.0), recording.lanes, sites())
    content = DatasetStudy().model_dump()
    content["sensing"]["channel"] |= {"kind": "link"}
    study = DatasetStudy.model_validate(content)
    sensor = watch_episode(study, scenario, recording.seed, recording)
    sensing = StretchSensing(study, recording, sensor, TIMING.before_decision_s)
    driving = watched(recording, Surroundings(recording), study.pairs, TIMING)
    stretches = [stretch for stretch in driving.stretches if stretch.tv.startswith("tv")]
    begin = time.process_time()
    for stretch in stretches:
        sensing.motion_of(stretch.tv, stretch.start_s, round((stretch.end_s - stretch.start_s) * 400) + 1, 400.0)
    conditioning_s = time.process_time() - begin
    begin = time.process_time()
    tracks = list(sensing.tracks(stretches))
    sensing_s = time.process_time() - begin - conditioning_s
    cutter = WindowCutter(Reports(sensing), study, SHAPE, TIMING.report_delay_s, TIMING.decision_s)
    batches = list(_windows(cutter, tracks))
    # The reports, which the first pass simulates, are there by now: the second one only cuts.
    begin = time.process_time()
    for _ in _windows(cutter, tracks):
        pass
    cutting_s = time.process_time() - begin
    trees, lanes = _trees(batches[0]), lanes_of(recording)
    begin = time.process_time()
    for tv, uv in batches:
        trees(in_frame(tv, uv, WindowSettings(), SHAPE.tv_rate_hz, SHAPE.uv_rate_hz))
    trees_s = time.process_time() - begin
    causal_s = _causal_s(batches, lanes, [len(track.stretch.decision_s) for track in tracks])
    begin = time.process_time()
    for tv, uv in batches:
        rule_answer(OnMap.in_one(tv, uv, SHAPE.tv_rate_hz, lanes))
    rule_s = time.process_time() - begin
    count = sum(len(track.stretch.decision_s) for track in tracks)
    panels = float(np.mean([track.n_sites for track in tracks]))
    return LiveTime(sensing_s, cutting_s, trees_s, causal_s, rule_s, count * TIMING.decision_s, panels)


def _windows(cutter: WindowCutter, tracks: list[SensedStretch]) -> Iterator[tuple[Array, Array]]:
    for track in tracks:
        yield from cutter.batches(track)


def _causal_s(batches: list[tuple[Array, Array]], lanes: LaneMap, decisions: list[int]) -> float:
    """Return the processor time in which a causal network answers, one step of all vehicles a decision, s.

    batches: of all windows, one vehicle after the other. decisions: of each vehicle.
    """
    causal = _causal()
    samples = [slice(-number, None) for number in causal.samples]
    first = np.cumsum([0, *decisions[:-1]])
    windows = [np.concatenate([of[k] for of in batches]) for k in (0, 1)]

    def on_map(tv: Array, uv: Array) -> Windows:
        seen = in_frame(tv, uv, WindowSettings(), SHAPE.tv_rate_hz, SHAPE.uv_rate_hz)
        return replace(seen, on_map=OnMap.in_one(tv, uv, SHAPE.tv_rate_hz, lanes))

    begin = time.process_time()
    _, state = causal.begin(on_map(*(of[first] for of in windows)))
    for k in range(1, min(decisions)):
        latest = [of[first + k][:, :, part] for of, part in zip(windows, samples, strict=True)]
        _, state = causal.step(on_map(*latest), state)
    return time.process_time() - begin


def _causal() -> CausalPredictor:
    """Return a causal network of default size. What it learns does not change the time of an answer."""
    streams = StreamFitSettings()
    facts = HazardFacts(
        horizons_s=streams.horizons_s, learned=tuple(of.text for of in WITH_HAZARD), passing=True,
        change_out=Intention.LEFT_LANE_CHANGE.text, uv=True, lanes=True, windows=WindowSettings(),
        decision_s=TIMING.decision_s, hours=0.0, events={},
    )  # fmt: skip
    network = CausalPredictor.built(facts, TrainSettings(model="causal", streams=streams), SHAPE)
    return CausalPredictor(facts, SHAPE, network.eval())


def _trees(batch: tuple[Array, Array]) -> TreesPredictor:
    """Return trees of default size, trained on noisy windows. What they learn does not change the time of an answer."""
    rng = np.random.default_rng(0)
    windows = in_frame(*batch, WindowSettings(), SHAPE.tv_rate_hz, SHAPE.uv_rate_hz)
    features = tree_features(windows, SHAPE.tv_rate_hz)
    many = np.repeat(features, 12, axis=0)
    noisy = many + rng.normal(0, 1 + np.abs(many).mean(axis=0), many.shape)
    label = np.arange(len(many)) % len(KNOWN)
    trees: HistGradientBoostingClassifier = fit_trees(noisy.astype(np.float32), label, TreesSettings(), 0)
    return TreesPredictor(trees, SHAPE.tv_rate_hz)


if __name__ == "__main__":
    print(json_text(run(), 2))
