"""An episode that is sensed as a scene while it is predicted: the answers are those on its stored streams."""

from __future__ import annotations

import numpy as np
import pytest

from isac_cosim.evaluation.in_traffic.measurement.evaluation import study_of
from isac_cosim.evaluation.in_traffic.streams.episode import Predictors, predicted, timing_of
from isac_cosim.evaluation.in_traffic.streams.predictions import lanes_of, run_answering
from isac_cosim.evaluation.in_traffic.streams.store import RUN
from isac_cosim.isacsim.scenarios.scenario import Scenario
from isac_cosim.isacsim.scene.tracks import SceneTracks
from isac_cosim.isacsim.sensing.sensors import scene as scene_sensor
from isac_cosim.isacsim.traffic.recordings.recording import Recording
from isac_cosim.labeling.generation.watching import watch_episode
from isac_cosim.labeling.streams.generate import streams_of
from isac_cosim.labeling.streams.settings import StreamDatasetSettings, StretchSettings
from isac_cosim.models.data.windows import OnMap
from isac_cosim.models.inference import Infer
from isac_cosim.models.runs.run import Run
from tests.support.scene_tracks import altered, tracks_of


def test_answers_live_are_those_on_stored_streams(
    trees_run: Run, scenario: Scenario, recording: Recording, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With one track that is lost for two seconds, and taken up as another one."""
    times: list[int] = []
    tracks = altered(tracks_of(recording, 25.0), 20.0, 22.0, {"follow0": None}, {"follow0": 77})

    def follow(*_: object) -> SceneTracks:
        times.append(1)
        return tracks

    monkeypatch.setattr(scene_sensor, "follow", follow)
    study = study_of(trees_run.card, "road", (1001, 1001), (2001, 2001), scene=True)
    live = predicted(study, scenario, recording, Predictors(trees_run.path, {})).episode
    assert len(times) == 1
    shape, watching = trees_run.card.shape, study.live.streams
    settings = StreamDatasetSettings(
        stretches=StretchSettings(**{name: getattr(watching, name) for name in StretchSettings.model_fields}),
        window_s=timing_of(study, shape).window_s,
        near_misses=study.live.near_misses,
    )
    facts, stored = streams_of(study.dataset, settings, scenario, recording)
    assert len(times) == 2
    assert [stretch.tv_id for stretch in stored].count("follow0") == 2
    assert (live.facts.uncovered, live.facts.events) == (facts.uncovered, facts.events)
    assert live.facts.uncovered["without_track"] > 10
    answer, apart = run_answering(Infer.load(trees_run.path)), []
    rates, lengths = (shape.tv_rate_hz, shape.uv_rate_hz), (shape.tv_length, shape.uv_length)
    decided = zip(live.vehicle.tolist(), live.time_s.tolist(), strict=True)
    at = {(live.names[of], round(time * 10)): row for row, (of, time) in enumerate(decided)}
    for stretch in stored:
        cut = [stretch.window(k, lengths, rates, watching.report_delay_s) for k in range(len(stretch.decision_s))]
        tv, uv = (np.stack(part) for part in zip(*cut, strict=True))
        answers = answer(OnMap.in_one(tv, uv, rates[0], lanes_of(recording)))
        rows = [at.pop((stretch.tv_id, round(time * 10))) for time in stretch.decision_s.tolist()]
        apart.append(np.abs(answers.probabilities - live.answers[RUN].probabilities[rows]).max(axis=1))
    assert not at
    # States are stored as float32, so that a tree's threshold may lie between both.
    assert np.quantile(np.concatenate(apart), 0.98) < 1e-3


def test_a_run_is_measured_in_a_scene_where_it_was_trained_in_one_or_where_it_is_asked_for(
    trees_run: Run, scenario: Scenario
) -> None:
    def sensor(card_of: Run, scene: bool | None) -> str:
        study = study_of(card_of.card, "road", scene=scene)
        assert (study.dataset.sensing.scene is None) == (scene is False or (scene is None and card_of is trees_run))
        return watch_episode(study.dataset, scenario, 1, sensor=study.live.streams.sensor).name

    stored = {**trees_run.card.dataset, "study": {"sensing": {"scene": {}, "channel": {"kind": "link"}}}}
    card = trees_run.card.model_copy(update={"dataset": stored})
    in_scene = Run(**{**vars(trees_run), "card": card})
    assert [sensor(trees_run, scene) for scene in (None, True, False)] == ["isac", "scene", "isac"]
    assert [sensor(in_scene, scene) for scene in (None, True, False)] == ["scene", "scene", "isac"]
