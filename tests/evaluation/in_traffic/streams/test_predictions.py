"""A stream is answered as a stored record is, and as a system that runs in time would answer it."""

from __future__ import annotations

from collections import deque
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scipy.special import softmax

from isac_cosim.evaluation.in_traffic.settings import LiveStudy
from isac_cosim.evaluation.in_traffic.streams.episode import timing_of
from isac_cosim.evaluation.in_traffic.streams.predictions import (
    Answers,
    WindowCutter,
    lanes_of,
    rule_answer,
    run_answering,
)
from isac_cosim.isacsim.panels import Panels
from isac_cosim.isacsim.scenarios.scenario import Scenario
from isac_cosim.isacsim.sensing.chain import fix
from isac_cosim.isacsim.sensing.following import Approach
from isac_cosim.isacsim.sensing.passages import Passage
from isac_cosim.isacsim.traffic.recordings.recording import Recording
from isac_cosim.labeling.generation.watching import watch_episode
from isac_cosim.labeling.road.surroundings import Surroundings
from isac_cosim.labeling.streams.reports import NoReports, Reports
from isac_cosim.labeling.streams.sensed import SensedStretch, StretchSensing
from isac_cosim.labeling.streams.stretches import watched
from isac_cosim.models.data.situation import FEATURES
from isac_cosim.models.data.windows import Ends, OnMap, Records, WindowSettings, cut
from isac_cosim.models.hazards.sight import N_SITUATION
from isac_cosim.models.inference import Infer
from isac_cosim.models.predictors.rule import RulePredictor, RuleSettings
from isac_cosim.models.runs.run import Run
from tests.support.streaming_filter import StreamingFilter


@pytest.fixture(scope="module")
def sensing(study: LiveStudy, scenario: Scenario, recording: Recording, trees_run: Run) -> StretchSensing:
    timing = timing_of(study, trees_run.card.shape)
    sensor = watch_episode(study.dataset, scenario, recording.seed, recording)
    return StretchSensing(study.dataset, recording, sensor, timing.before_decision_s)


@pytest.fixture(scope="module")
def tracks(sensing: StretchSensing, study: LiveStudy, recording: Recording, trees_run: Run) -> list[SensedStretch]:
    timing = timing_of(study, trees_run.card.shape)
    driving = watched(recording, Surroundings(recording), study.dataset.pairs, timing)
    return list(sensing.tracks(driving.stretches))


def answers(track: SensedStretch, sensing: StretchSensing, run: Run, delay_s: float = 0.0) -> Answers:
    cutter = WindowCutter(Reports(sensing), sensing.study, run.card.shape, delay_s, 0.1)
    answer, lanes = run_answering(Infer.load(run.path)), lanes_of(sensing.recording)
    rate_hz = run.card.shape.tv_rate_hz
    return Answers.joined([answer(OnMap.in_one(tv, uv, rate_hz, lanes)) for tv, uv in cutter.batches(track)])


@pytest.mark.parametrize("kind", ["trees_run", "network_run"])
def test_a_stream_is_answered_as_a_stored_record(
    kind: str, tracks: list[SensedStretch], sensing: StretchSensing, request: pytest.FixtureRequest
) -> None:
    """Five seconds of a stretch as a dataset holds them, and windows cut from them at the same instants."""
    run: Run = request.getfixturevalue(kind)
    track = tracks[0]
    stretch = track.stretch
    first = 30  # predictions into the stretch
    ends_s = stretch.decision_s[first : first + 20]
    start_s = round(float(ends_s[0]) - 2.0, 9)
    offset = round((start_s - stretch.start_s) * 400)
    reports = Reports(sensing)
    uv = reports.window(stretch.uv[first], start_s + 4.99, 500)
    columns = ["sample_id", "scenario", "seed", "label", "t_start", "t_onset", "t_commit", "snr_db"]
    table = pd.DataFrame([("live-0", "road", 1, 0, start_s, start_s, start_s, 0.0)], columns=columns)
    record = Records(track.state[None, :, offset : offset + 2000], uv[None], 400.0, 100.0, table)
    steps = np.rint((ends_s - start_s) * 100).astype(np.int64)
    windows = cut(record, Ends(np.zeros(len(steps), np.int64), steps), run.card.settings.windows)
    outputs = run.predictor(windows)
    live = answers(track, sensing, run)
    expected = softmax(outputs.logits / run.card.temperature, axis=1)
    np.testing.assert_allclose(live.probabilities[first : first + 20], expected, atol=1e-6)
    np.testing.assert_allclose(live.features[first : first + 20], outputs.features, rtol=1e-5, atol=1e-5)


def test_lanes_add_the_situation_to_the_features(
    tracks: list[SensedStretch], sensing: StretchSensing, trees_run: Run
) -> None:
    """The features of the rule are the situation; without lanes, nothing but the features of the run differs."""
    shape = trees_run.card.shape
    tv, uv = next(WindowCutter(Reports(sensing), sensing.study, shape, 0.0, 0.1).batches(tracks[0]))
    infer, lanes = Infer.load(trees_run.path), lanes_of(sensing.recording)
    live = OnMap.in_one(tv, uv, shape.tv_rate_hz, lanes)
    plain, more = (run_answering(infer, with_lanes)(live) for with_lanes in (False, True))
    np.testing.assert_array_equal(more.probabilities, plain.probabilities)
    width = plain.features.shape[1]
    np.testing.assert_array_equal(more.features[:, :width], plain.features)
    by_rule = rule_answer(live)
    np.testing.assert_array_equal(more.features[:, width:], by_rule.features)
    logits = by_rule.features[:, : -len(FEATURES)][:, -6:]
    np.testing.assert_allclose(softmax(logits, axis=1), by_rule.probabilities, rtol=1e-5)
    left, right = more.features[:, width + 3], more.features[:, width + 4]
    np.testing.assert_allclose(left + right, lanes.place(tv[:, :2, 0], tv[:, 2:4, 0]).width_m, rtol=1e-5)
    assert np.ptp(left) > 0


def test_without_a_uv_the_situation_does_not_depend_on_where_the_road_lies(
    tracks: list[SensedStretch], sensing: StretchSensing, trees_run: Run
) -> None:
    """What stands for the missing reports rests at the origin: its distance would say where on the map the TV is."""
    shape = trees_run.card.shape
    tv, uv = next(WindowCutter(NoReports(), sensing.study, shape, 0.0, 0.1).batches(tracks[0]))
    assert not uv.any()
    infer, lanes = Infer.load(trees_run.path), lanes_of(sensing.recording)
    width = infer(tv, uv).features.shape[1]
    elsewhere = uv + np.array([300.0, 40.0, 0.0, 0.0, 0.0, 0.0])[:, None]
    apart, alike = (
        [
            run_answering(infer, with_lanes=True, with_uv=with_uv)(
                OnMap.in_one(tv, reports, shape.tv_rate_hz, lanes)
            ).features[:, width:]
            for reports in (uv, elsewhere)
        ]
        for with_uv in (True, False)
    )
    assert np.abs(apart[0] - apart[1]).max() > 10.0
    assert alike[0].shape[1] == N_SITUATION
    np.testing.assert_array_equal(alike[0], alike[1])


def test_the_batch_gives_what_ring_buffers_and_the_streaming_filter_give(
    tracks: list[SensedStretch], sensing: StretchSensing, scenario: Scenario, trees_run: Run
) -> None:
    """Fix by fix and report by report in the order of time; nothing but the buffers is kept."""
    track = min(tracks, key=lambda one: one.state.shape[1])
    shape, stretch, infer = trees_run.card.shape, track.stretch, Infer.load(trees_run.path)
    settings = sensing.study.sensing
    key = ("live", "road", 1, stretch.tv, f"{stretch.start_s:.6f}")
    approach = Approach.of(
        Passage(stretch.tv, stretch.start_s, track.truth, key, acquired=True), 400, settings.tracking
    )
    fixes = fix(approach, 400, Panels.of(scenario.sites, settings.target_height_m), settings, key).fixes
    streaming, reports = StreamingFilter(1 / 400, settings.tracking), Reports(sensing)
    tv_buffer: deque[np.ndarray] = deque(maxlen=shape.tv_length)
    batched = answers(track, sensing, trees_run)
    decisions = {round((t - stretch.start_s) * 400): k for k, t in enumerate(stretch.decision_s.tolist())}
    answered = 0
    for sample in range(track.state.shape[1]):
        valid = fixes.valid[sample]
        state = streaming.step(fixes.state[sample] if valid else None, fixes.covariance[sample] if valid else None)
        assert state is not None
        tv_buffer.append(state.astype(np.float32))
        np.testing.assert_allclose(state, track.state[:, sample], rtol=1e-5, atol=1e-4)
        k = decisions.get(sample)
        if k is not None and k % 10 == 0:
            uv = reports.window(stretch.uv[k], stretch.decision_s[k], shape.uv_length)
            inference = infer(np.stack(tv_buffer, axis=1), uv)
            np.testing.assert_allclose(inference.probabilities[0], batched.probabilities[k], atol=1e-3)
            answered += 1
    assert answered >= 5


def test_a_delay_makes_reports_older(tracks: list[SensedStretch], sensing: StretchSensing, trees_run: Run) -> None:
    cutters = [
        WindowCutter(Reports(sensing), sensing.study, trees_run.card.shape, delay_s, 0.1) for delay_s in (0.0, 0.1)
    ]
    (tv, uv), (tv_late, uv_late) = (next(cutter.batches(tracks[0])) for cutter in cutters)
    np.testing.assert_array_equal(tv, tv_late)
    np.testing.assert_array_equal(uv_late[1:], uv[:-1])  # predictions come every 0.1 s


def test_the_rule_answers_as_on_a_dataset_with_roads(
    tracks: list[SensedStretch], sensing: StretchSensing, trees_run: Run
) -> None:
    shape, windows = trees_run.card.shape, WindowSettings(window_s=1.2)
    tv, uv = next(WindowCutter(Reports(sensing), sensing.study, shape, 0.0, 0.1).batches(tracks[0]))
    lanes = lanes_of(sensing.recording)
    answered = rule_answer(OnMap.in_one(tv, uv, shape.tv_rate_hz, lanes))
    columns = ["sample_id", "scenario", "seed", "label", "t_start", "t_onset", "t_commit", "snr_db"]
    table = pd.DataFrame([("live-0", "road", 1, 0, 0.0, 0.0, 0.0, 0.0)] * len(tv), columns=columns)
    longer = [np.concatenate([x[..., :1], x], axis=2).astype(np.float32) for x in (tv, uv)]
    records = Records(longer[0], longer[1], 400.0, 100.0, table, lambda _: lanes)
    ends = Ends(np.arange(len(tv)), np.full(len(tv), 120))
    logits = RulePredictor(RuleSettings())(cut(records, ends, windows)).logits
    np.testing.assert_allclose(answered.score, logits.max(axis=1), atol=1e-5)


def test_every_vehicle_has_one_stream_of_reports(sensing: StretchSensing) -> None:
    reports, again = Reports(sensing), Reports(sensing)
    vehicle = next(iter(sensing.recording.tracks))
    long, short = reports.window(vehicle, 8.0, 300), again.window(vehicle, 7.5, 100)
    np.testing.assert_array_equal(long[:, 150:250], short)
    with pytest.raises(ValueError, match="has not reported"):
        reports.window(vehicle, 1.0, 300)


def test_reports_carry_the_noise_of_the_study(sensing: StretchSensing) -> None:
    vehicle = next(iter(sensing.recording.tracks))
    rates = sensing.study.record
    true = sensing.motion_of(vehicle, 10.0, 1000, rates.uv_rate_hz)
    reported = Reports(sensing).window(vehicle, 19.99, 1000)
    deviation = (reported - true).std(axis=1)
    np.testing.assert_allclose(deviation, [0.02, 0.02, 0.05, 0.05, 0.1, 0.1], rtol=0.15)
    silent = replace(sensing, study=sensing.study.model_copy(update={"report": type(sensing.study.report)(
        position_sd_m=0.0, speed_sd_mps=0.0, acceleration_sd_mps2=0.0)}))  # fmt: skip
    np.testing.assert_allclose(Reports(silent).window(vehicle, 19.99, 1000), true, atol=2e-4)
