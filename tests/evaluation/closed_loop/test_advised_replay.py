"""The instructions of a closed loop in the replay of its page."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from isac_cosim.evaluation.closed_loop.evaluation import ClosedLoopEvaluation, evaluate_advisories
from isac_cosim.evaluation.closed_loop.settings import AdvisorySettings, ClosedLoopSettings
from isac_cosim.evaluation.closed_loop.store import ArmEpisode, file_name, read_arm, write_arm
from isac_cosim.evaluation.in_traffic.settings import LiveStudy
from isac_cosim.evaluation.report.replay import advised
from isac_cosim.evaluation.report.replay.advised import with_instructions
from isac_cosim.evaluation.report.replay.advised_again import SAYS
from isac_cosim.evaluation.report.replay.content import RATE_HZ, Replay
from isac_cosim.evaluation.report.replay.kept import ADVISED_FILE, read_advised
from isac_cosim.models.runs.run import Run
from tests.support.recorded_feedback import RecordedFeedback
from tests.support.scripted import InlineEngine

LOOP = ClosedLoopSettings(
    arms=("isac",), advisories=AdvisorySettings(network_delay_s=0.1, reaction_s=(0.2, 0.2)), after_s=4.0
)


@pytest.fixture(scope="module")
def evaluation(trees_run: Run, study: LiveStudy, tmp_path_factory: pytest.TempPathFactory) -> ClosedLoopEvaluation:
    return evaluate_advisories(trees_run, study, LOOP, tmp_path_factory.mktemp("loop"), InlineEngine())


def arm_of(evaluation: ClosedLoopEvaluation, seed: int) -> ArmEpisode:
    return read_arm(evaluation.task.folder / file_name(evaluation.result.scenario, seed, "isac"))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("page")


@pytest.fixture(scope="module")
def shown(evaluation: ClosedLoopEvaluation, folder: Path) -> Replay:
    feedback = RecordedFeedback()
    replay = with_instructions(None, evaluation, InlineEngine(), feedback, folder)
    assert replay is not None
    assert not [line for line in feedback.messages if "warning" in line]
    return replay


@pytest.mark.slow
def test_the_instructions_shown_are_those_of_the_arm(evaluation: ClosedLoopEvaluation, shown: Replay) -> None:
    assert 1 <= len(shown.records) <= advised.MOST_ADVISED
    begun = 0
    for record in shown.records:
        facts = arm_of(evaluation, int(record.id.split("-")[1])).facts
        sent = {(one.vehicle, SAYS[one.instruction], round(one.time_s, 3)) for one in facts.advisories}  # type: ignore[index]
        raised = {(one.tv, one.intention, round(one.time_s, 3)) for one in facts.alarms}
        assert record.told
        assert record.alarms
        for alarm in record.alarms:
            assert (record.tv_id, alarm.intention, round(record.start_s + alarm.time_s, 3)) in raised
            assert alarm.false is None
        for told in record.told:
            assert (told.vehicle, told.says, round(record.start_s + told.sent_s, 3)) in sent
            if told.begun_s is not None:
                begun += 1
                assert told.begun_s - told.sent_s == pytest.approx(0.3, abs=0.11)
                assert told.ended_s is None or told.ended_s > told.begun_s
            assert f"vehicle {told.vehicle} is told at {told.sent_s:.1f} s to {told.says}" in record.about
    assert begun


@pytest.mark.slow
def test_vehicles_move_as_in_the_arm_and_not_as_without_advisories(
    evaluation: ClosedLoopEvaluation, shown: Replay
) -> None:
    for record in shown.records:
        driving = arm_of(evaluation, int(record.id.split("-")[1])).driving
        rows = driving.vehicle == driving.names.index(record.tv_id)
        times = record.start_s + np.arange(record.truth.shape[1]) / RATE_HZ
        known = (times >= driving.time_s[rows][0]) & (times <= driving.time_s[rows][-1])
        for axis, values in enumerate((driving.x[rows], driving.y[rows])):
            expected = np.interp(times[known], driving.time_s[rows], values)
            assert np.abs(record.truth[axis, known] - expected).max() < 0.5
        first = round(record.sensed_from_s * RATE_HZ)
        error = np.hypot(*(record.sensed - record.truth[:, first : first + record.sensed.shape[1]]))
        assert np.median(error) < 1.0


@pytest.mark.slow
def test_a_page_is_made_again_from_what_was_kept(
    evaluation: ClosedLoopEvaluation, shown: Replay, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*_: object) -> None:
        raise AssertionError("nothing is driven again")

    monkeypatch.setattr(advised.AdvisedAgain, "__call__", fails)
    again = with_instructions(None, evaluation, InlineEngine(), RecordedFeedback(), folder)
    assert again is not None
    assert again.packed() == shown.packed()
    assert [one.about for one in again.records] == [one.about for one in shown.records]


@pytest.mark.parametrize("damage", ["", '{"a": 1}', '{"a": [{"id": 1}]}'])
def test_a_damaged_file_counts_as_none(damage: str, tmp_path: Path) -> None:
    (tmp_path / ADVISED_FILE).write_text(damage)
    assert read_advised(tmp_path) == {}


@pytest.mark.slow
def test_an_arm_that_is_driven_otherwise_is_left_out_and_said(
    evaluation: ClosedLoopEvaluation, shown: Replay, tmp_path: Path
) -> None:
    """In the stored arm, the predicted time is a billionth longer than it was."""
    arms = tmp_path / "arms"
    shutil.copytree(evaluation.task.folder, arms)
    for seed in evaluation.task.study.dataset.seeds:
        stored = arm_of(evaluation, seed)
        facts = stored.facts.model_copy(update={"predicted_hours": stored.facts.predicted_hours * (1 + 1e-9)})
        write_arm(arms / file_name(evaluation.result.scenario, seed, "isac"), replace(stored, facts=facts))
    changed, feedback = replace(evaluation, task=replace(evaluation.task, folder=arms)), RecordedFeedback()
    left = with_instructions(shown, changed, InlineEngine(), feedback, tmp_path)
    assert left is not None
    assert left.records == shown.records
    assert any(line.startswith("Left out: ") and "is not the same" in line for line in left.remarks)
    assert all("shows no instruction of" in line for line in feedback.messages)
    assert not (tmp_path / ADVISED_FILE).exists()


@pytest.mark.slow
def test_the_page_holds_them(shown: Replay) -> None:
    packed = json.loads(json.dumps(shown.packed()))
    for record, plain in zip(shown.records, packed["records"], strict=True):
        for told, one in zip(record.told, plain["told"], strict=True):
            assert (one["vehicle"], one["says"], one["fate"]) == (told.vehicle, told.says, told.fate)
            if isinstance(one["shown"], int):
                assert plain["others"][one["shown"]]["id"] == told.vehicle
            else:
                assert {"tv": record.tv_id, "uv": record.uv_id}.get(one["shown"]) in (told.vehicle, None)
    assert "driven again for this page" in shown.remarks[0]
