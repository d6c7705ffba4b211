"""`evaluate --explain`: means by intention, a figure of a record, and what is refused."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import cosim
from isac_cosim.base.errors import InputError
from isac_cosim.evaluation.on_windows.evaluation import evaluate_records
from isac_cosim.evaluation.on_windows.explained import inspect_windows, mean_age_s
from isac_cosim.evaluation.on_windows.results import read_metrics
from isac_cosim.evaluation.on_windows.settings import EvaluateSettings
from isac_cosim.labeling.intentions import Intention
from isac_cosim.models.data.windows import Records, draw_ends
from isac_cosim.models.runs.run import Run
from isac_cosim.models.training.training import train_records
from tests.support.made_up import MADE_OF, SMALL_RUN
from tests.support.made_up_dataset import write_dataset

TINY = {"width": 16, "heads": 2, "encoder_layers": 1, "feedforward": 16}
ONCE = EvaluateSettings(ends_per_record=1)


@pytest.fixture(scope="module")
def castformer_run(records: Records, tmp_path_factory: pytest.TempPathFactory) -> Run:
    settings = type(SMALL_RUN).model_validate({**SMALL_RUN.model_dump(), "model": "castformer", "castformer": TINY})
    return train_records(records, MADE_OF, tmp_path_factory.mktemp("runs") / "castformer", settings)


def test_the_means_by_intention_are_those_of_its_windows(castformer_run: Run, records: Records, tmp_path: Path) -> None:
    evaluation = evaluate_records(castformer_run, records, MADE_OF, tmp_path / "out", ONCE, explains=True)
    explained = evaluation.result.explained
    assert explained is not None
    stored = read_metrics(tmp_path / "out")
    assert stored is not None
    assert stored.explained is not None
    predictions = evaluation.measured[0].predictions
    unseen = records.take(np.isin(records.groups, np.unique(predictions.group)))
    ends = draw_ends(unseen, castformer_run.card.settings.windows, "evaluate", ONCE.seed)
    seen = inspect_windows(castformer_run, unseen, ends)
    assert seen.attention is not None
    assert seen.weight is not None
    rows = unseen.label[ends.row] == Intention.OVERTAKE
    overtake = explained["overtake"]
    assert overtake.n == rows.sum()
    assert overtake.weight["context"].value == pytest.approx(seen.weight[rows, 2].mean())
    assert overtake.age_s["out"].value == pytest.approx(mean_age_s(seen.attention, 0.1)[rows, 1].mean())
    for means in explained.values():
        assert sum(weight.value or 0 for weight in means.weight.values()) == pytest.approx(1)
        assert 0.1 <= (means.age_s["in"].value or 0) <= 2.1


def test_the_mean_age_is_weighted_by_attention() -> None:
    attention = np.array([[[0, 0.25, 0.75], [0, 1, 0]]])
    np.testing.assert_allclose(mean_age_s(attention, 0.1), [[0.175, 0.1]])


def test_without_being_asked_nothing_is_explained(castformer_run: Run, records: Records, tmp_path: Path) -> None:
    evaluate_records(castformer_run, records, MADE_OF, tmp_path / "out", ONCE)
    assert "explained" not in json.loads((tmp_path / "out" / "metrics.json").read_text())


def test_other_predictors_are_refused(trees_run: Run, records: Records, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"--explain: .* is of trees; only castformer has attention"):
        evaluate_records(trees_run, records, MADE_OF, tmp_path / "out", ONCE, explains=True)


def test_a_network_without_modules_is_refused(records: Records, tmp_path: Path) -> None:
    off = {**TINY, "rsf": False, "cpe": False, "fsn": False}
    settings = type(SMALL_RUN).model_validate({**SMALL_RUN.model_dump(), "model": "castformer", "castformer": off})
    run = train_records(records, MADE_OF, tmp_path / "run", settings)
    with pytest.raises(InputError, match="none of the modules rsf, cpe and fsn"):
        evaluate_records(run, records, MADE_OF, tmp_path / "out", ONCE, explains=True)


@pytest.mark.slow
def test_a_user_explains_a_run(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    dataset, run = tmp_path / "data", tmp_path / "run"
    write_dataset(dataset)
    words = ["train", str(dataset), "-o", str(run), "--model", "castformer", "--epochs", "1", "--quiet"]
    assert cosim.main(words) == 0
    assert cosim.main(["evaluate", str(run), "--data", str(dataset), "--explain", "--quiet", "--json"]) == 0
    result = json.loads(capfd.readouterr().out)
    assert set(result["explained"]["hard_brake"]) == {"n", "age_s", "gate", "residual", "weight"}
    page = (run / "evaluation" / "index.html").read_text()
    assert "What the network looks at" in page
    assert "age of the frames" in page
    assert (run / "evaluation" / "explained.png").stat().st_size > 10_000
    assert cosim.main(["evaluate", str(run), "--traffic", "motorway", "--explain"]) == 2
    assert "--explain applies to windows of a dataset" in capfd.readouterr().err
