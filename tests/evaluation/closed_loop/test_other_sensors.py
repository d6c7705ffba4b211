"""Sensors that another installed package offers: stored records, streams and running traffic are sensed with them.

One watches a whole episode before it says anything about a vehicle. The other has the form that sensors had before
that: it is given stored records.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from isac_cosim.base.errors import InputError
from isac_cosim.command_line.arguments import SenseArguments, resense_settings
from isac_cosim.evaluation.closed_loop.evaluation import evaluate_advisories
from isac_cosim.evaluation.closed_loop.loop import ClosedLoop
from isac_cosim.evaluation.closed_loop.settings import AdvisorySettings, ClosedLoopSettings
from isac_cosim.evaluation.in_traffic.settings import LiveStudy, StreamSettings
from isac_cosim.isacsim.scenarios.scenario import Scenario
from isac_cosim.isacsim.sensing.sensors import SENSORS
from isac_cosim.isacsim.traffic.sources.registry import motion_source
from isac_cosim.labeling.dataset.dataset import Dataset
from isac_cosim.labeling.generation.cost_estimate import estimate, sensed_anew
from isac_cosim.labeling.generation.generate import generate
from isac_cosim.labeling.generation.resense import resense
from isac_cosim.labeling.generation.watching import watch_episode
from isac_cosim.labeling.road.surroundings import Surroundings
from isac_cosim.labeling.streams.sensed import StretchSensing
from isac_cosim.labeling.streams.stretches import Timing, watched
from isac_cosim.models.inference import Infer
from isac_cosim.models.runs.run import Run
from isac_cosim.studies.sweep_axes import SweepAxes, sensings
from tests.support.scripted import InlineEngine, ScriptedSource, small_study

PACKAGE = '''
"""Sensors of another package."""

import numpy as np

from isac_cosim.base.seeding import stream
from isac_cosim.isacsim.sensing.passages import SensedRecord
from isac_cosim.isacsim.sensing.sensors.by_record import RecordPicture


class Crowd:
    """Its error grows with the vehicles on the road, which are counted once an episode."""

    label, cost_s, by_sites, filtered, unusable = "the crowd", 1e-6, False, False, "never"

    def refusal(self, settings):
        return None

    def watch(self, traffic, settings):
        return CrowdPicture(traffic, settings)


class CrowdPicture(RecordPicture):
    def __init__(self, traffic, settings):
        super().__init__(traffic)
        self.sd_m = float(settings.options.get("sd_m", 1.0))
        self.vehicles = 1 if traffic.recording is None else len(traffic.recording.tracks)

    def record(self, passages):
        return [record_of(passage.truth, passage.key, self.sd_m * self.vehicles) for passage in passages]

    def step(self, piece, uv_of):
        self.vehicles = len(piece.names)
        return super().step(piece, uv_of)


class Stored:
    """Knows nothing but stored records."""

    label, cost_s, by_sites, filtered, unusable = "the store", 1e-6, False, False, "never"

    def refusal(self, settings):
        return None

    def sense(self, records, settings):
        assert records.truth.shape[1] == 6 and len(records.truth) == len(records.keys)
        assert records.carrier is None or records.carrier.state.shape[:2] == records.truth.shape[:2]
        assert records.past is None or records.past.shape[:2] == records.truth.shape[:2]
        assert len(records.sites)
        return [record_of(*record, 3.0) for record in zip(records.truth, records.keys, strict=True)]


class Short(Crowd):
    """Returns states that are too short."""

    def watch(self, traffic, settings):
        return ShortPicture(traffic, settings)


class ShortPicture(CrowdPicture):
    def record(self, passages):
        return [record_of(passage.truth[:, 1:], passage.key, 1.0) for passage in passages]


def record_of(truth, key, sd_m):
    state = truth.copy()
    state[:2] += sd_m * stream(*key, "crowd").standard_normal(truth[:2].shape)
    return SensedRecord(state, state[:4], n_sites=0, snr_db=np.nan, detected=1.0, usable=True)


class Nothing:
    label, cost_s, by_sites, filtered, unusable = "nothing", 1e-6, False, False, "never"

    def refusal(self, settings):
        return None


CROWD, STORED, SHORT, NOTHING = Crowd(), Stored(), Short(), Nothing()
'''
NAMES = ("crowd", "stored", "short", "nothing")
TIMING = Timing(
    decision_s=0.1, window_s=1.0, report_delay_s=0.0, run_in_s=0.5, margin_s=0.8, outcome_s=0.0, longest_stretch_s=60.0
)
INLINE = InlineEngine()


@pytest.fixture(autouse=True)
def _installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The package, importable and with metadata; the registry looks for entry points anew, and forgets them after."""
    (tmp_path / "their_sensors.py").write_text(PACKAGE)
    metadata = tmp_path / "their_sensors-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: their-sensors\nVersion: 1.0\n")
    points = "".join(f"{name} = their_sensors:{name.upper()}\n" for name in NAMES)
    (metadata / "entry_points.txt").write_text(f"[isac_cosim.sensors]\n{points}")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "their_sensors", raising=False)
    monkeypatch.setattr(SENSORS, "_items", dict(SENSORS._items))
    monkeypatch.delitem(SENSORS.__dict__, "_offered", raising=False)
    monkeypatch.setitem(SENSORS.__dict__, "_offered", SENSORS._offered)


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    source = ScriptedSource(tmp_path_factory.mktemp("road"))
    return generate(small_study(seeds={"first": 1, "last": 1}), tmp_path_factory.mktemp("data"), INLINE, source=source)


def deviation_m(difference: np.ndarray) -> float:
    return float(np.std(difference[..., :2, :]))


def with_sensor(study: LiveStudy, sensor: str, **options: object) -> LiveStudy:
    content = study.model_dump()
    content["live"]["streams"] |= {"sensor": sensor, "options": options}
    return LiveStudy.model_validate(content)


@pytest.mark.parametrize(("name", "sd_m"), [("crowd", 1.0), ("stored", 3.0)])
def test_a_dataset_is_sensed_anew(name: str, sd_m: float, dataset: Dataset, tmp_path: Path) -> None:
    """Only the records are at hand, so nobody is counted."""
    sensed = resense(dataset, resense_settings(dataset, SenseArguments(name)), tmp_path / "out", INLINE)
    sensed.verify()
    assert set(sensed.frame()["sensor"]) == {name}
    assert len(sensed) == len(dataset)
    arrays = sensed.arrays("tv", "tv_truth")
    assert deviation_m(arrays["tv"] - arrays["tv_truth"]) == pytest.approx(sd_m, rel=0.05)
    assert sensed_anew(small_study(), estimate(small_study()), name).cpu_s > 0
    assert [sensing.sensor for sensing in sensings(SweepAxes(sensors=(name,)))] == [name]


@pytest.mark.parametrize(("name", "per_vehicle_m", "fixed_m"), [("crowd", 0.5, 0.0), ("stored", 0.0, 3.0)])
def test_a_stream_is_sensed(
    name: str, per_vehicle_m: float, fixed_m: float, study: LiveStudy, scenario: Scenario
) -> None:
    recording = motion_source(study.dataset).record(scenario, 1)
    chosen = with_sensor(study, name, sd_m=0.5)
    sensor = watch_episode(study.dataset, scenario, 1, recording, name, chosen.sensor_settings)
    sensing = StretchSensing(study.dataset, recording, sensor, TIMING.before_decision_s)
    driving = watched(recording, Surroundings(recording), study.dataset.pairs, TIMING)
    tracks = list(sensing.tracks(driving.stretches))
    assert tracks
    expected_m = fixed_m + per_vehicle_m * len(recording.tracks)
    for track in tracks:
        assert deviation_m(track.state - track.truth) == pytest.approx(expected_m, rel=0.1)
    assert not any(sensing.uncovered.values())


@pytest.mark.parametrize(("name", "per_vehicle_m", "fixed_m"), [("crowd", 0.5, 0.0), ("stored", 0.0, 3.0)])
def test_running_traffic_is_sensed(
    name: str, per_vehicle_m: float, fixed_m: float, study: LiveStudy, scenario: Scenario, infer: Infer
) -> None:
    """Against the truth of the same simulation."""
    errors: list[np.ndarray] = []
    vehicles: set[int] = set()
    for sensor in (name, "truth"):
        chosen = with_sensor(study, sensor, sd_m=0.5)
        loop = ClosedLoop.of(scenario, 1, chosen, ClosedLoopSettings(), infer.run.card.shape, sensor, None)
        known = []
        for decision in loop.decisions():
            knowledge = decision.knowledge
            known += list(knowledge.windows[0])
            if knowledge.tv:
                vehicles.add(len(knowledge.surroundings.recording.tracks))
        errors.append(np.stack(known))
    assert vehicles == {5}
    assert deviation_m(errors[0] - errors[1]) == pytest.approx(fixed_m + per_vehicle_m * 5, rel=0.05)


def test_both_are_arms_of_a_closed_loop(trees_run: Run, study: LiveStudy, tmp_path: Path) -> None:
    """The open loop chooses the alarms on what one of them senses; the other one is an arm beside it."""
    advisories = AdvisorySettings(network_delay_s=0.0, reaction_s=(0.0, 0.0))
    settings = ClosedLoopSettings(arms=("none", "stored", "crowd"), advisories=advisories, after_s=4.0)
    chosen = with_sensor(study, "crowd", sd_m=0.01)
    result = evaluate_advisories(trees_run, chosen, settings, tmp_path / "out", INLINE).result
    assert list(result.arms) == ["none", "placebo", "stored", "crowd"]
    assert result.arms["placebo"].what == "alarms by the crowd; nothing is sent"
    assert result.arms["stored"].what == "advisories on alarms by the store"
    assert result.closed_loop.placebo_equals_none
    assert result.arms["crowd"].predicted_hours > 0
    stored = json.loads((tmp_path / "out" / "metrics.json").read_text())
    assert stored["made_by"]["study"]["live"]["streams"]["sensor"] == "crowd"
    assert stored["made_by"]["study"]["live"]["streams"]["options"] == {"sd_m": 0.01}


def test_an_answer_that_does_not_fit_is_refused(dataset: Dataset, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="sensor short: returned no finite state"):
        resense(dataset, resense_settings(dataset, SenseArguments("short")), tmp_path / "out", INLINE)


def test_a_thing_that_cannot_sense_is_refused(dataset: Dataset, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="sensor nothing: is not one: it lacks a method"):
        resense(dataset, resense_settings(dataset, SenseArguments("nothing")), tmp_path / "out", INLINE)


def test_settings_of_sensors_are_stored_where_they_are_not_the_default() -> None:
    assert not {"sensor", "radar", "options"} & StreamSettings().model_dump(mode="json").keys()
    chosen = StreamSettings.model_validate({"sensor": "radar", "radar": {"condition": "weather"}})
    assert StreamSettings.model_validate_json(chosen.model_dump_json()) == chosen
    assert chosen.model_dump()["radar"]["condition"] == "weather"


def test_an_unknown_sensor_is_refused_by_name() -> None:
    with pytest.raises(ValidationError, match="unknown sensor 'crwd': did you mean crowd"):
        StreamSettings(sensor="crwd")
    with pytest.raises(ValidationError, match="unknown arm 'crwd': choose among none, placebo"):
        ClosedLoopSettings(arms=("crwd",))
