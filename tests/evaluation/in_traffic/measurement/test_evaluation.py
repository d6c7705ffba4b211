"""An evaluation from beginning to end, on scripted traffic in this process."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from isac_cosim.base.errors import InputError, RunError
from isac_cosim.base.workers.engine import LocalEngine
from isac_cosim.evaluation.in_traffic.measurement import measuring
from isac_cosim.evaluation.in_traffic.measurement.evaluation import evaluate_traffic, study_of, warnings
from isac_cosim.evaluation.in_traffic.measurement.summary import TrafficEvaluation
from isac_cosim.evaluation.in_traffic.scores.results import TrafficResult
from isac_cosim.evaluation.in_traffic.settings import LiveStudy, Method
from isac_cosim.evaluation.in_traffic.streams.episode import Predictors, predicted
from isac_cosim.evaluation.in_traffic.streams.store import EPISODES, RUN, read_episode
from isac_cosim.isacsim.scenarios.scenario import Scenario
from isac_cosim.isacsim.traffic.recordings.recording import Recording
from isac_cosim.labeling.generation.settings import SeedRange
from isac_cosim.models.data.windows import Records
from isac_cosim.models.hazards.sight import N_SITUATION
from isac_cosim.models.runs.run import Run
from isac_cosim.models.training.training import train_records
from tests.support.made_up import MADE_OF, SMALL_RUN
from tests.support.recorded_feedback import RecordedFeedback
from tests.support.scripted import InlineEngine, ScriptedSource


@pytest.fixture(scope="module")
def evaluation(trees_run: Run, study: LiveStudy, source: ScriptedSource, folder: Path) -> TrafficEvaluation:
    return evaluate_traffic(trees_run, study, folder, InlineEngine(), source=source)


def test_the_result_says_what_the_contract_asks_for(evaluation: TrafficEvaluation, folder: Path) -> None:
    stored = json.loads((folder / "metrics.json").read_text())
    assert TrafficResult.model_validate(stored) == evaluation.result
    for scores in (*stored["by_intention"].values(), *stored["natural"]["by_intention"].values()):
        assert {"precision", "recall", "f1", "lead_time_s", "false_alarms_per_vehicle_hour"} <= set(scores)
    assert [point["false_alarms_per_vehicle_hour"] for point in stored["recall_at"]] == [0.1, 0.3, 1, 3, 10]
    assert {"random", "rule", "situation"} == set(stored["baselines"])
    assert set(stored["methods"]) == {"reject", "background"}
    assert set(stored["frozen_at"]) == {"shared", "separate"}
    assert evaluation.real_time_factor is not None


def test_five_intentions_are_measured_with_the_better_kind_of_alarm(evaluation: TrafficEvaluation) -> None:
    result, five = evaluation.result, evaluation.result.five_classes
    assert five is not None
    assert five.alarms is not None
    assert result.alarms is not None
    assert (five.alarms.method, set(five.baselines)) == (result.alarms.method, {"rule", "situation"})
    assert five.over_all.events == result.over_all.events
    assert five.by_intention["overtake"].events == 0


def test_what_takes_time_is_predicted_and_what_is_sudden_is_recognised(evaluation: TrafficEvaluation) -> None:
    """Each measured seed has a lane change and a hard brake; neither is in the other's question."""
    prediction, recognition = evaluation.result.prediction, evaluation.result.recognition
    assert prediction is not None
    assert recognition is not None
    assert set(prediction.by_intention) == {"left_lane_change", "right_lane_change", "evasive_swerve"}
    assert set(recognition.by_intention) == {"hard_brake", "hard_accel"}
    assert (prediction.events, recognition.events) == (2, 2)
    assert (prediction.by_commit_plus_s, recognition.by_commit_plus_s) == (0.0, 0.5)
    assert set(prediction.recall_at_lead) == {"0.5", "1"}
    assert [point.chosen_for for point in prediction.at] == [0.1, 0.3, 1.0, 3.0, 10.0]
    assert evaluation.result.stress is None


def test_both_events_of_each_seed_count(evaluation: TrafficEvaluation) -> None:
    events = {name: scores.events for name, scores in evaluation.result.by_intention.items()}
    assert events["hard_brake"] == 2
    assert sum(events.values()) + sum(evaluation.result.events_left_out.values()) >= 4


def test_coverage_adds_up(evaluation: TrafficEvaluation) -> None:
    coverage = evaluation.result.coverage
    assert coverage.share is not None
    assert coverage.share + sum(coverage.uncovered.values()) == pytest.approx(1.0)
    assert coverage.vehicle_hours == pytest.approx(coverage.share * coverage.driving_hours)
    # Leaders have no leader, so at most half of the driving is predicted.
    assert 0.2 < coverage.share < 0.5
    assert coverage.km / coverage.vehicle_hours == pytest.approx(20 * 3.6, rel=0.15)


@pytest.mark.slow
def test_another_engine_and_a_resumed_folder_give_the_same_bytes(
    evaluation: TrafficEvaluation,
    trees_run: Run,
    study: LiveStudy,
    source: ScriptedSource,
    folder: Path,
    tmp_path: Path,
) -> None:
    with pytest.raises(RunError, match="1 of 4 episodes failed, seed 12"):
        evaluate_traffic(trees_run, study, tmp_path, InlineEngine(), source=replace(source, broken=(12,)))
    kept = (tmp_path / "episodes" / "road-21.parquet").stat().st_mtime_ns
    evaluate_traffic(trees_run, study, tmp_path, InlineEngine(), source=source)
    assert (tmp_path / "episodes" / "road-21.parquet").stat().st_mtime_ns == kept
    assert_same_files(tmp_path, folder, study)


def assert_same_files(one: Path, other: Path, study: LiveStudy) -> None:
    for name in ("metrics.json", "study.json", *(f"episodes/road-{seed}.parquet" for seed in study.seeds)):
        assert (one / name).read_bytes() == (other / name).read_bytes()


@pytest.mark.slow
def test_worker_processes_give_the_same_bytes(
    evaluation: TrafficEvaluation,
    trees_run: Run,
    study: LiveStudy,
    source: ScriptedSource,
    folder: Path,
    tmp_path: Path,
) -> None:
    evaluate_traffic(trees_run, study, tmp_path, LocalEngine(2), source=source)
    assert_same_files(tmp_path, folder, study)


@pytest.fixture(scope="module")
def tv_alone(records: Records, tmp_path_factory: pytest.TempPathFactory) -> Run:
    settings = SMALL_RUN.model_copy(update={"model": "tv-alone"})
    return train_records(records, MADE_OF, tmp_path_factory.mktemp("runs") / "tv_alone", settings)


@pytest.mark.slow
def test_truth_and_driving_without_a_uv_are_measured_beside(
    evaluation: TrafficEvaluation,
    trees_run: Run,
    tv_alone: Run,
    study: LiveStudy,
    source: ScriptedSource,
    tmp_path: Path,
) -> None:
    streams = study.live.streams.model_copy(update={"truth": True})
    both = study.model_copy(update={"live": study.live.model_copy(update={"streams": streams})})
    result = evaluate_traffic(trees_run, both, tmp_path, InlineEngine(), source=source, alone=tv_alone).result
    # Neither changes what the run does on sensed motion.
    assert result.methods == evaluation.result.methods
    assert result.truth is not None
    assert result.truth.method in result.methods
    assert set(result.truth.methods) == set(result.methods)
    rates = [cost.false_alarms_per_vehicle_hour for cost in result.truth.lost]
    assert rates == list(study.live.scoring.false_alarms_per_vehicle_hour)
    sensed = {point.false_alarms_per_vehicle_hour: point.recall for point in result.recall_at}
    assert {cost.false_alarms_per_vehicle_hour: cost.sensed for cost in result.truth.lost} == pytest.approx(sensed)
    # The leaders have no UV, and nothing happens to them.
    alone = result.alone
    assert alone is not None
    assert (alone.model, alone.over_all.events) == ("tv-alone", 0)
    assert alone.share is not None
    assert alone.share == pytest.approx(result.coverage.uncovered["no_connected_leader"], abs=0.02)
    of_alone = read_episode(sorted((tmp_path / "episodes").glob("*-alone.parquet"))[0], features=True)
    assert of_alone.answers[RUN].features.shape[1] > N_SITUATION
    kept = [path.stat().st_mtime_ns for path in sorted((tmp_path / "episodes").iterdir())]
    evaluate_traffic(trees_run, both, tmp_path, InlineEngine(), source=source, alone=tv_alone)
    assert [path.stat().st_mtime_ns for path in sorted((tmp_path / "episodes").iterdir())] == kept


def test_an_episode_on_disk_is_the_episode(evaluation: TrafficEvaluation, folder: Path) -> None:
    episode = read_episode(folder / "episodes" / "road-11.parquet")
    truth = evaluation.truths[0].episode
    assert (episode.facts, episode.names) == (truth.facts, truth.names)
    np.testing.assert_array_equal(episode.time_s, truth.time_s)
    np.testing.assert_array_equal(episode.answers["rule"].score, truth.answers["rule"].score)


def test_traffic_without_vehicles_gives_an_empty_result_and_a_warning(
    trees_run: Run, study: LiveStudy, source: ScriptedSource, tmp_path: Path
) -> None:
    feedback = RecordedFeedback()
    empty = replace(source, empty=tuple(study.seeds))
    result = evaluate_traffic(trees_run, study, tmp_path, InlineEngine(), feedback, source=empty).result
    assert (result.vehicle_hours, result.over_all.recall, result.alarms) == (0.0, None, None)
    assert "no vehicle was predicted" in feedback.messages[0]


def test_no_connected_vehicle_is_a_warning_too(
    trees_run: Run, study: LiveStudy, source: ScriptedSource, tmp_path: Path
) -> None:
    pairs = study.dataset.pairs.model_copy(update={"connected_share": 0.0})
    alone = study.model_copy(update={"dataset": study.dataset.model_copy(update={"pairs": pairs})})
    result = evaluate_traffic(trees_run, alone, tmp_path, InlineEngine(), source=source).result
    assert result.vehicle_hours == 0.0
    assert result.coverage.uncovered["no_connected_leader"] > 0.8
    assert sum(result.events_left_out.values()) > 0


def test_vehicles_that_fewer_than_two_sites_see_are_counted_and_not_predicted(
    trees_run: Run, study: LiveStudy, scenario: Scenario, recording: Recording
) -> None:
    view = study.dataset.sensing.view.model_copy(update={"range_m": 20.0})
    sensing = study.dataset.sensing.model_copy(update={"view": view})
    blind = study.model_copy(update={"dataset": study.dataset.model_copy(update={"sensing": sensing})})
    episode = predicted(blind, scenario, recording, Predictors(trees_run.path, {})).episode
    facts = episode.facts
    assert (len(episode.time_s), episode.vehicle_hours) == (0, 0.0)
    assert facts.uncovered["too_few_sites"] > 300
    assert sum(facts.uncovered.values()) == facts.instants
    assert {event.left_out for event in facts.events} == {"not_watched"}


def test_a_reader_is_warned_where_scores_say_little(evaluation: TrafficEvaluation) -> None:
    result = evaluation.result.model_copy(update={"alarms_keep_to_rate": True, "development_hours": 31.0})
    assert warnings(result) == []
    (line,) = warnings(result.model_copy(update={"development_hours": 9.0}))
    assert "chosen on 9.0 vehicle-hours" in line
    (line,) = warnings(result.model_copy(update={"alarms_keep_to_rate": False}))
    assert "no threshold keeps to 1 false alarms per vehicle-hour" in line
    (line,) = warnings(result.model_copy(update={"over_all": result.over_all.model_copy(update={"events": 0})}))
    assert "no event counts" in line


@pytest.mark.slow
def test_without_development_seeds_as_many_are_run_as_it_takes(
    evaluation: TrafficEvaluation, trees_run: Run, study: LiveStudy, source: ScriptedSource, tmp_path: Path
) -> None:
    """Each seed holds as much driving: with hours for four and a half seeds, the fifth is the last, for any engine."""
    asked = study_of(trees_run.card, "road")
    assert (asked.development_h, asked.development.first) == (30.0, 2001)
    assert study_of(trees_run.card, "road", development=(11, 12)).development_h is None
    assert evaluation.result.development_hours is not None
    one_h = evaluation.result.development_hours / 2
    few = study.model_copy(update={"development": SeedRange(first=2001, last=2100), "development_h": 4.5 * one_h})
    result = evaluate_traffic(trees_run, few, tmp_path, InlineEngine(), source=source).result
    assert (result.made_by.study.development.first, result.made_by.study.development.last) == (2001, 2005)
    assert result.development_hours == pytest.approx(5 * one_h, rel=0.05)
    again = evaluate_traffic(trees_run, few, tmp_path, InlineEngine(), source=source).result
    assert again == result


def test_the_scenario_may_be_one_that_the_run_was_not_trained_on(evaluation: TrafficEvaluation) -> None:
    """The run knows records alone, of other seeds: there is nothing of this road in it."""
    result = evaluation.result
    trained = {group.rpartition("-")[0] for groups in result.made_by.run.split.values() for group in groups}
    assert result.scenario not in trained
    assert result.vehicle_hours > 0


@pytest.mark.parametrize("kinds", [("reject", "background"), ("background",)])
def test_a_compared_run_of_records_is_measured_as_it_is_by_itself(
    trees_run: Run,
    study: LiveStudy,
    source: ScriptedSource,
    kinds: tuple[Method, ...],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """By the better of its kinds of alarm, of which the one that knows "none" sees the lanes."""
    monkeypatch.setattr(measuring, "OF_RECORDS", kinds)
    result = evaluate_traffic(trees_run, study, tmp_path, InlineEngine(), source=source, against=[trees_run]).result
    (name,) = result.made_by.against
    beside = result.baselines[name]
    episode = read_episode(next((tmp_path / EPISODES).glob("*.parquet")), features=True)
    np.testing.assert_array_equal(episode.answers[name].features, episode.answers[RUN].features)
    assert beside.alarms is not None
    assert beside.alarms.method in kinds
    assert (beside.alarms, beside.over_all, beside.frozen_at) == (result.alarms, result.over_all, result.frozen_at)
    assert result.compared[name].prediction == result.prediction


def test_results_of_earlier_versions_still_open(evaluation: TrafficEvaluation, folder: Path) -> None:
    """They hold no alarms for each rate, intervals without the number of seeds, and bootstrap settings.

    Nor do they say that speeds do not wander, that commanded brakes come at once and lane changes wherever there is a
    lane, that trees do not see the lanes and learn from windows after the commit, too, and that predictions come until
    the end of a track, which was so.
    """

    def former(content: Any) -> Any:
        if isinstance(content, list):
            return [former(item) for item in content]
        if not isinstance(content, dict):
            return content
        left_out = {"frozen_at", "speed_wander", "rise_s", "clear_s", "lanes", "until", "outcome_s"}
        left_out |= {"seeds"} if "low" in content else set()
        kept = {key: former(value) for key, value in content.items() if key not in left_out}
        if "choice" in kept:
            kept["choice"] = {k: v for k, v in kept["choice"].items() if k not in ("threshold", "least_events")}
            kept["scoring"]["resamples"] = 1000
        return kept

    stored = json.loads((folder / "metrics.json").read_text())
    opened = TrafficResult.model_validate(former(stored))
    assert opened.over_all.recall == evaluation.result.over_all.recall
    assert opened.frozen_at == {}
    study = opened.made_by.study
    assert study.live.scoring == evaluation.result.made_by.study.live.scoring
    assert study.dataset.traffic.speed_wander.sd_share == (0.0, 0.0)
    assert study.dataset.maneuvers.hard_brake.rise_s == (0.0, 0.0)
    assert study.dataset.maneuvers.lane_change.clear_s == 0.0
    assert not study.live.background.lanes
    assert study.live.background.until == "end"
    assert study.live.streams.outcome_s == 0


def test_a_folder_of_another_evaluation_is_refused(
    evaluation: TrafficEvaluation, trees_run: Run, study: LiveStudy, source: ScriptedSource, folder: Path
) -> None:
    streams = study.live.streams.model_copy(update={"decision_s": 0.2})
    other = study.model_copy(update={"live": study.live.model_copy(update={"streams": streams})})
    with pytest.raises(InputError, match="holds an evaluation of another run or other settings"):
        evaluate_traffic(trees_run, other, folder, InlineEngine(), source=source)


@pytest.mark.slow
def test_more_seeds_and_another_choice_of_alarms_keep_the_episodes(
    trees_run: Run, study: LiveStudy, source: ScriptedSource, tmp_path: Path
) -> None:
    def with_seeds(last: int, rate: float) -> LiveStudy:
        content = study.model_dump()
        content["dataset"]["seeds"]["last"] = last
        content["live"]["choice"]["false_alarms_per_vehicle_hour"] = rate
        return LiveStudy.model_validate(content)

    for name, last in (("once", 13), ("later", 12), ("later", 13)):
        evaluate_traffic(trees_run, with_seeds(last, last - 11.0), tmp_path / name, InlineEngine(), source=source)
        if last == 12:
            kept = {path: path.stat().st_mtime_ns for path in (tmp_path / name / "episodes").iterdir()}
    assert all(path.stat().st_mtime_ns == time for path, time in kept.items())
    assert (tmp_path / "once/metrics.json").read_bytes() == (tmp_path / "later/metrics.json").read_bytes()


@pytest.mark.slow
def test_a_run_alone_and_a_run_compared_are_different_evaluations(
    trees_run: Run, tv_alone: Run, study: LiveStudy, source: ScriptedSource, tmp_path: Path
) -> None:
    evaluate_traffic(trees_run, study, tmp_path, InlineEngine(), source=source, alone=tv_alone)
    with pytest.raises(InputError, match="holds an evaluation of another run"):
        evaluate_traffic(trees_run, study, tmp_path, InlineEngine(), source=source, against=[tv_alone])
