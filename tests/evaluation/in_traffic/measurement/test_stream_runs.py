"""Live evaluation of predictors that were trained on streams: their own log-odds raise the alarms."""

from __future__ import annotations

from pathlib import Path
from shutil import copytree

import numpy as np
import pytest

from isac_cosim.base.errors import InputError
from isac_cosim.evaluation.in_traffic.alarms.alarms import LEAST_PROBABILITY, NEVER, hazard_levels
from isac_cosim.evaluation.in_traffic.alarms.stream import levelling
from isac_cosim.evaluation.in_traffic.measurement.evaluation import _named, evaluate_traffic, study_of
from isac_cosim.evaluation.in_traffic.measurement.headline import OWN_RATES
from isac_cosim.evaluation.in_traffic.measurement.summary import SITUATION, TrafficEvaluation
from isac_cosim.evaluation.in_traffic.settings import AlarmSettings, LiveStudy
from isac_cosim.evaluation.in_traffic.streams.predictions import AlongAnswering, Answers, answering_of
from isac_cosim.evaluation.in_traffic.streams.store import EPISODES, RUN, read_episode
from isac_cosim.evaluation.on_windows.evaluation import evaluate_records
from isac_cosim.evaluation.on_windows.settings import EvaluateSettings
from isac_cosim.evaluation.report.live_parts import LiveCompared
from isac_cosim.evaluation.report.parts import Shown
from isac_cosim.labeling.intentions import KNOWN, Intention
from isac_cosim.models.data.windows import Records
from isac_cosim.models.inference import Infer
from isac_cosim.models.runs.run import Run, load_run
from isac_cosim.models.training.on_streams import train_on_streams
from tests.support.made_up import MADE_OF
from tests.support.scripted import InlineEngine, ScriptedSource
from tests.support.stream_runs import scripted_streams, settings

OVERTAKE, LEFT = KNOWN.index(Intention.OVERTAKE), KNOWN.index(Intention.LEFT_LANE_CHANGE)


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Run]:
    folder = tmp_path_factory.mktemp("stream runs")
    streams = scripted_streams(folder)
    alone = train_on_streams(streams, folder / "alone", settings("trees", uv=False))
    models = {model: train_on_streams(streams, folder / model, settings(model)) for model in ("trees", "causal")}
    return models | {"alone": alone}


def small_study(run: Run) -> LiveStudy:
    content = study_of(run.card, "road", (21, 22), (11, 12)).model_dump()
    content["live"]["choice"] |= {"thresholds": 20, "confirmations": [[1, 1], [2, 3]]}
    return LiveStudy.model_validate(content)


@pytest.fixture(scope="module")
def evaluation(
    runs: dict[str, Run], source: ScriptedSource, tmp_path_factory: pytest.TempPathFactory
) -> TrafficEvaluation:
    run = runs["trees"]
    out = tmp_path_factory.mktemp("evaluation") / "out"
    return evaluate_traffic(
        run, small_study(run), out, InlineEngine(), source=source, against=[runs["causal"]], alone=runs["alone"]
    )


def test_alarms_are_raised_by_the_odds_that_the_run_answers(evaluation: TrafficEvaluation) -> None:
    result = evaluation.result
    assert list(result.methods) == ["hazard"]
    assert result.alarms is not None
    assert result.alarms.method == "hazard"
    assert {"rule", "random", "causal network"} <= result.baselines.keys()
    assert SITUATION not in result.baselines
    assert result.alone is not None
    assert list(result.alone.methods) == ["hazard"]
    assert result.by_intention["left_lane_change"].recall == 1.0


def test_five_classes_have_the_odds_of_the_pull_out(evaluation: TrafficEvaluation, tmp_path: Path) -> None:
    assert evaluation.result.five_classes is not None
    assert evaluation.result.five_classes.by_intention["left_lane_change"].recall == 1.0
    assert evaluation.result.prediction is not None


def test_everything_compared_is_asked_what_an_operator_asks(evaluation: TrafficEvaluation) -> None:
    result = evaluation.result
    assert result.compared.keys() == {"rule", "causal network"} == result.made_by.against.keys() | {"rule"}
    of_network = result.compared["causal network"].prediction
    assert of_network is not None
    assert of_network.events == result.prediction.events if result.prediction else None


def test_an_intention_has_a_budget_of_its_own(evaluation: TrafficEvaluation) -> None:
    """A softer budget names no fewer, and one intention alone has no fewer alarms than among others."""
    assert evaluation.result.prediction is not None
    left = evaluation.result.prediction.by_intention["left_lane_change"]
    assert [scores.chosen_for for scores in left.own_budget] == list(OWN_RATES)
    recalls = [scores.recall or 0.0 for scores in left.own_budget]
    assert recalls == sorted(recalls)
    assert recalls[0] >= (left.recall or 0.0) > 0.0
    for scores in left.own_budget:
        assert (scores.recall_at_lead["1"] or 0.0) <= (scores.recall_at_lead["0.5"] or 0.0) <= (scores.recall or 0.0)


def test_the_page_shows_everything_that_was_compared(evaluation: TrafficEvaluation, tmp_path: Path) -> None:
    shown = {part.name: part for part in LiveCompared().parts(Shown(evaluation.result, tmp_path))}
    assert shown.keys() == {"live-compared-stimulated", "live-own-budgets-stimulated"}
    predictors = [row["predictor"] for row in shown["live-compared-stimulated"].rows]
    assert predictors == [evaluation.result.name, "rule of the road", "causal network"]
    assert " at " in str(shown["live-compared-stimulated"].rows[0]["predicted, 1 an hour"])
    left = [row for row in shown["live-own-budgets-stimulated"].rows if row["intention"] == "left lane change"]
    assert len(left) == 3


def test_runs_of_one_kind_are_told_apart_by_their_folders(runs: dict[str, Run], tmp_path: Path) -> None:
    others = [load_run(copytree(runs["trees"].path, tmp_path / place)) for place in ("a/again", "b/again", "c")]
    names = list(_named(runs["trees"], [*others, runs["causal"]]))
    again = runs["trees"].name
    assert names == [f"{again}, again 1", f"{again}, again 2", f"{again}, c", "causal network"]


def test_answers_on_disk_are_the_odds_of_each_intention(
    runs: dict[str, Run], source: ScriptedSource, tmp_path: Path
) -> None:
    """They need not add up to one, and their levels are their log-odds."""
    run = runs["trees"]
    evaluate_traffic(run, small_study(run), tmp_path / "out", InlineEngine(), source=source)
    episode = read_episode(next((tmp_path / "out" / EPISODES).glob("*.parquet")), features=True)
    answers = episode.answers[RUN]
    assert answers.probabilities.sum(axis=1).min() < 0.5
    level = hazard_levels(answers)
    likely = (answers.probabilities > 0.01) & (answers.probabilities < 0.99)
    odds = answers.probabilities[likely] / (1 - answers.probabilities[likely])
    assert level[likely] == pytest.approx(np.log(odds), abs=1e-4)


def test_levels_of_what_is_hardly_possible_raise_no_alarm() -> None:
    probabilities = np.array([[0.0, LEAST_PROBABILITY / 2, 0.5, 1.0, 0.2, 0.9]], np.float32)
    answers = Answers(probabilities, np.zeros(1, np.float32), np.zeros((1, 1), np.float32))
    level = hazard_levels(answers)[0]
    assert level[0] == level[1] == NEVER
    assert level[2] == pytest.approx(0.0, abs=1e-6)
    assert np.isfinite(level[3])
    assert (levelling(AlarmSettings(method="hazard", threshold=0.0), None)(answers) == level).all()


def test_a_run_that_sees_the_uv_is_refused_without_one(
    runs: dict[str, Run], source: ScriptedSource, tmp_path: Path
) -> None:
    run = runs["trees"]
    with pytest.raises(InputError, match="--no-uv"):
        evaluate_traffic(run, small_study(run), tmp_path / "out", InlineEngine(), source=source, alone=runs["causal"])


def test_the_training_seeds_are_refused(runs: dict[str, Run], source: ScriptedSource, tmp_path: Path) -> None:
    run = runs["trees"]
    study = LiveStudy.model_validate({**small_study(run).model_dump(), "development": {"first": 1, "last": 1}})
    with pytest.raises(InputError, match="was trained on seed 1"):
        evaluate_traffic(run, study, tmp_path / "out", InlineEngine(), source=source)


def test_records_are_not_what_it_is_measured_on(runs: dict[str, Run], records: Records, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="--traffic SCENARIO"):
        evaluate_records(runs["trees"], records, MADE_OF, tmp_path / "out", EvaluateSettings())


@pytest.mark.slow
def test_a_run_that_goes_along_the_stream_answers_as_on_windows(
    runs: dict[str, Run], source: ScriptedSource, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run, answers = runs["causal"], []
    assert isinstance(answering_of(Infer.load(run.path), 0.1), AlongAnswering)
    for name in ("along", "windows"):
        if name == "windows":
            monkeypatch.setattr("isac_cosim.models.inference.Infer.steps_s", None)
        out = tmp_path / name
        evaluate_traffic(run, small_study(run), out, InlineEngine(), source=source)
        path = next((out / EPISODES).glob("*-21.parquet"))
        answers.append(read_episode(path, features=True).answers[RUN])
    assert len(answers[0].score) > 100
    assert answers[0].features == pytest.approx(answers[1].features, abs=1e-3)
    assert answers[0].probabilities == pytest.approx(answers[1].probabilities, abs=1e-4)
