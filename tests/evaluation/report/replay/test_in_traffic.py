"""The worst moments of an evaluation in traffic: which ones are picked, and that they move as they did."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from isac_cosim.evaluation.in_traffic.alarms.alarms import Alarms
from isac_cosim.evaluation.in_traffic.measurement.evaluation import evaluate_traffic
from isac_cosim.evaluation.in_traffic.measurement.measuring import MeasuredAlarms
from isac_cosim.evaluation.in_traffic.measurement.summary import TrafficEvaluation
from isac_cosim.evaluation.in_traffic.settings import LiveStudy
from isac_cosim.evaluation.in_traffic.streams.store import RUN
from isac_cosim.evaluation.report.replay import moments
from isac_cosim.evaluation.report.replay.content import RATE_HZ, Replay
from isac_cosim.evaluation.report.replay.in_traffic import replay_in_traffic
from isac_cosim.evaluation.report.replay.kept import MOMENTS_FILE, read_kept
from isac_cosim.evaluation.report.replay.moments import Mistake, worst_moments
from isac_cosim.isacsim.traffic.motion import MotionSettings, states
from isac_cosim.labeling.intentions import KNOWN
from isac_cosim.models.runs.run import Run
from tests.support.recorded_feedback import RecordedFeedback
from tests.support.scripted import InlineEngine, ScriptedSource

HARD_ACCEL = [intention.text for intention in KNOWN].index("hard_accel")


def measured_of(evaluation: TrafficEvaluation) -> MeasuredAlarms:
    return next(iter(evaluation.methods.values()))


@pytest.fixture(scope="module")
def evaluation(
    trees_run: Run, study: LiveStudy, source: ScriptedSource, tmp_path_factory: pytest.TempPathFactory
) -> TrafficEvaluation:
    """Two measured episodes, each with a lane change and a hard brake; for every window, an alarm for an acceleration.

    Nobody accelerates: all these alarms are false.
    """
    found = evaluate_traffic(trees_run, study, tmp_path_factory.mktemp("live"), InlineEngine(), source=source)
    method, measured = next(iter(found.methods.items()))
    raised = []
    for truth in found.truths:
        rows = np.arange(len(truth.episode.time_s))
        vehicle, time_s = truth.episode.vehicle[rows], truth.episode.time_s[rows]
        raised.append(Alarms(np.full(len(rows), HARD_ACCEL), rows, vehicle, time_s))
    return replace(found, methods={method: replace(measured, alarms=tuple(raised))})


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Of the evaluation: `shown` keeps there what it simulated."""
    return tmp_path_factory.mktemp("page")


@pytest.fixture(scope="module")
def shown(evaluation: TrafficEvaluation, source: ScriptedSource, folder: Path) -> Replay:
    replay = replay_in_traffic(evaluation, InlineEngine(), source=source, folder=folder)
    assert replay is not None
    return replay


def test_the_surest_false_alarm_and_the_least_likely_miss_come_first(evaluation: TrafficEvaluation) -> None:
    picked = worst_moments(evaluation.truths, measured_of(evaluation))
    shares = [truth.episode.answers[RUN].probabilities for truth in evaluation.truths]
    assert not picked[0].missed
    assert picked[0].probability == max(float(share[:, HARD_ACCEL].max()) for share in shares)
    missed = []
    for truth, share in zip(evaluation.truths, shares, strict=True):
        for event in truth.episode.facts.events:
            if event.left_out is None:
                name = truth.episode.names.index(event.vehicle)
                times = truth.episode.time_s
                asked = (truth.episode.vehicle == name) & (event.onset - 2.0 <= times) & (times <= event.commit)
                missed.append(float(share[asked, [one.text for one in KNOWN].index(event.intention)].max()))
    assert len(missed) == 4
    assert picked[1].missed
    assert picked[1].probability == min(missed)


def test_moments_of_a_vehicle_do_not_overlap_and_keep_to_the_bounds(
    evaluation: TrafficEvaluation, monkeypatch: pytest.MonkeyPatch
) -> None:
    measured = measured_of(evaluation)
    picked = worst_moments(evaluation.truths, measured)
    for k, one in enumerate(picked):
        for other in picked[:k]:
            apart = one.span_s[0] >= other.span_s[1] or other.span_s[0] >= one.span_s[1]
            assert apart or (one.episode, one.tv) != (other.episode, other.tv)
    assert len({moment.episode for moment in picked}) == 2
    monkeypatch.setattr(moments, "MOST_EPISODES", 1)
    assert {moment.episode for moment in worst_moments(evaluation.truths, measured)} == {picked[0].episode}
    monkeypatch.setattr(moments, "MOST_MOMENTS", 2)
    assert len(worst_moments(evaluation.truths, measured)) == 2


def test_a_long_maneuver_is_not_shown_whole() -> None:
    begin, end = Mistake(0, 0, 0, 100.0, 160.0, 0.5, True).span_s
    assert end - begin == moments.LONGEST_S


def test_vehicles_move_as_they_did_and_are_sensed_near_there(shown: Replay, source: ScriptedSource) -> None:
    assert shown.records
    for record in shown.records:
        recording = source.record(source.load("road"), int(record.id.split("-")[1]))
        for name, path, from_s in ((record.tv_id, record.truth, 0.0), (record.uv_id, record.uv, record.uv_from_s)):
            times = record.start_s + from_s + np.arange(path.shape[1]) / RATE_HZ
            driven = states(recording, recording.tracks[name], times, MotionSettings())[:2]
            assert np.allclose(path, driven, atol=1e-6)
        first = round(record.sensed_from_s * RATE_HZ)
        error = np.hypot(*(record.sensed - record.truth[:, first : first + record.sensed.shape[1]]))
        assert 0.0 < np.median(error) < 1.0
        assert {other.id for other in record.others} == recording.tracks.keys() - {record.tv_id, record.uv_id}


def test_alarms_maneuvers_and_answers_are_those_of_the_evaluation(shown: Replay, evaluation: TrafficEvaluation) -> None:
    for record in shown.records:
        truth = next(one for one in evaluation.truths if record.id.startswith(f"road-{one.episode.facts.seed}-"))
        episode = truth.episode
        end_s = record.start_s + (record.truth.shape[1] - 1) / RATE_HZ
        mine = [one for one in episode.facts.events if one.vehicle == record.tv_id]
        expected = [one for one in mine if one.onset <= end_s and one.commit >= record.start_s]
        assert [(one.intention, one.onset_s + record.start_s) for one in record.maneuvers] == [
            (event.intention, pytest.approx(event.onset)) for event in expected
        ]
        assert record.answers is not None
        own = episode.vehicle == episode.names.index(record.tv_id)
        for k, share in enumerate(record.answers.probabilities):
            time_s = record.start_s + record.answers.from_s + k * record.answers.step_s
            row = np.flatnonzero(own & (np.abs(episode.time_s - time_s) < 1e-6))
            assert np.array_equal(share, episode.answers[RUN].probabilities[row[0]])
        assert len(record.alarms) >= len(record.answers.probabilities)
        assert all(alarm.false for alarm in record.alarms)


def test_the_list_says_what_happened_and_where(shown: Replay) -> None:
    names = [record.shown_name for record in shown.records]
    kinds = [name.partition(":")[0] for name in names]
    assert kinds == sorted(kinds)  # False alarms, then misses.
    assert any(name.startswith("False alarm: hard accel, road-1") for name in names)
    assert any(name.startswith("Missed: ") for name in names)
    assert not shown.some_wrong
    assert "from 2 of 2 measured episodes, simulated again" in shown.remarks[0]


def test_an_episode_that_drives_otherwise_is_left_out_and_said(
    evaluation: TrafficEvaluation, source: ScriptedSource
) -> None:
    feedback, changed = RecordedFeedback(), replace(source, empty=(evaluation.truths[0].episode.facts.seed,))
    shown = replay_in_traffic(evaluation, InlineEngine(), feedback, changed)
    assert shown is not None
    assert {record.id.split("-")[1] for record in shown.records} == {"12"}
    assert "is not the same" in feedback.messages[0]
    assert "Left out: road-11" in shown.remarks[1]


@pytest.mark.parametrize("fault", ["broken", "wrong", "empty"])
def test_an_evaluation_whose_traffic_is_gone_has_a_page_without_a_replay(
    fault: str, evaluation: TrafficEvaluation, source: ScriptedSource
) -> None:
    feedback = RecordedFeedback()
    assert replay_in_traffic(evaluation, InlineEngine(), feedback, replace(source, **{fault: (11, 12)})) is None
    assert feedback.messages
    assert all(line.startswith("warning: the page shows no moment") for line in feedback.messages)


def test_without_alarms_there_is_nothing_to_show(evaluation: TrafficEvaluation) -> None:
    assert replay_in_traffic(replace(evaluation, methods={}), InlineEngine()) is None


def test_a_page_is_made_again_from_what_was_kept(
    evaluation: TrafficEvaluation, shown: Replay, source: ScriptedSource, folder: Path
) -> None:
    nothing_runs = replace(source, broken=(11, 12))
    again = replay_in_traffic(evaluation, InlineEngine(), RecordedFeedback(), nothing_runs, folder)
    assert again is not None
    assert again.packed() == shown.packed()
    assert [one.shown_about for one in again.records] == [one.shown_about for one in shown.records]


def test_only_what_no_longer_fits_is_simulated_again(
    evaluation: TrafficEvaluation, shown: Replay, source: ScriptedSource, folder: Path, tmp_path: Path
) -> None:
    assert shown.records
    shutil.copy(folder / MOMENTS_FILE, tmp_path)
    first, *others = evaluation.truths
    facts = first.episode.facts.model_copy(update={"fingerprint": "another"})
    changed = replace(evaluation, truths=(replace(first, episode=replace(first.episode, facts=facts)), *others))
    again = replay_in_traffic(changed, InlineEngine(), RecordedFeedback(), replace(source, broken=(11, 12)), tmp_path)
    assert again is not None
    assert {record.id.split("-")[1] for record in again.records} == {"12"}


@pytest.mark.slow
def test_moments_that_lack_a_tv_are_made_anew(
    evaluation: TrafficEvaluation, shown: Replay, source: ScriptedSource, folder: Path, tmp_path: Path
) -> None:
    whole = (folder / MOMENTS_FILE).read_text()
    (tmp_path / MOMENTS_FILE).write_text(json.dumps({key: seen[1:] for key, seen in json.loads(whole).items()}))
    again = replay_in_traffic(evaluation, InlineEngine(), source=source, folder=tmp_path)
    assert again is not None
    assert again.packed() == shown.packed()
    assert json.loads((tmp_path / MOMENTS_FILE).read_text()) == json.loads(whole)


DAMAGES: dict[str, Callable[[str], str]] = {
    "empty": lambda text: "",
    "cut off": lambda text: text[: len(text) // 2],
    "another thing": lambda text: '{"a": 1}',
    "paths that are none": lambda text: text.replace('"truth":[[', '"truth":[[[0]],['),
    "no numbers": lambda text: text.replace('"truth":[[', '"truth":[[NaN,'),
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_file_of_moments_counts_as_none(damage: str, shown: Replay, folder: Path, tmp_path: Path) -> None:
    assert shown.records
    assert len(read_kept(folder)) == 2
    whole = (folder / MOMENTS_FILE).read_text()
    (tmp_path / MOMENTS_FILE).write_text(DAMAGES[damage](whole))
    assert read_kept(tmp_path) == {}
