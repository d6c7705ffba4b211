"""Known intentions held out in turn: the table against the predictions of the runs trained without them."""

import io
import json
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console
from sklearn.metrics import roc_auc_score

from isac_cosim.base.errors import InputError
from isac_cosim.evaluation.on_windows.predictions import predict, unseen
from isac_cosim.evaluation.on_windows.settings import EvaluateSettings
from isac_cosim.labeling.intentions import KNOWN, Intention
from isac_cosim.models.data.windows import Records, draw_ends
from isac_cosim.models.runs.run import load_run
from isac_cosim.studies.held_out import HeldOutResult, hold_out_each, table
from tests.support.made_up import MADE_OF, SMALL_RUN

TREES = SMALL_RUN.model_copy(update={"model": "trees"})


@pytest.mark.slow
def test_each_known_intention_is_unknown_in_turn(records: Records, tmp_path: Path) -> None:
    some = records.take(np.isin(records.label, [0, 2, 3, 4, 6]))
    result = hold_out_each(some, MADE_OF, tmp_path / "out", TREES, EvaluateSettings(ends_per_record=1))
    assert list(result.held_out) == ["hard_brake", "right_lane_change", "overtake", "hard_accel"]
    content = json.loads((tmp_path / "out" / "held_out.json").read_text())
    assert content == result.model_dump(mode="json")
    assert HeldOutResult.model_validate(content) == result
    assert content["made_by"]["dataset"] == MADE_OF
    for name, row in result.held_out.items():
        run = load_run(tmp_path / "out" / name)
        assert run.card.counts[name] == 0
        left = unseen(some, [run])
        predictions = predict(run, left, draw_ends(left, TREES.windows, "evaluate", 0, per_record=1))
        held_out = predictions.label == Intention[name.upper()]
        known = np.isin(predictions.label, KNOWN) & ~held_out
        assert (row.n, row.n_known) == (held_out.sum(), known.sum())
        value = predictions.outputs.probabilities.max(axis=1)
        truth = np.repeat([1, 0], [known.sum(), held_out.sum()])
        expected = roc_auc_score(truth, np.concatenate([value[known], value[held_out]]))
        assert row.unknown_scores["msp"].auroc == pytest.approx(expected)
    mean = np.mean([row.unknown_scores["msp"].auroc for row in result.held_out.values()])
    assert result.mean["msp"].auroc == pytest.approx(mean)
    console = Console(file=io.StringIO(), width=200)
    console.print(table(result))
    printed = console.file.getvalue()  # type: ignore[attr-defined]
    assert f"{result.held_out['overtake'].unknown_scores['energy'].auroc:.3f} /" in printed
    assert printed.count("*") == 4


def test_a_foreign_folder_is_left_alone(records: Records, tmp_path: Path) -> None:
    (tmp_path / "foreign.txt").write_text("foreign")
    with pytest.raises(InputError, match="is not empty and holds no held-out study"):
        hold_out_each(records, MADE_OF, tmp_path, TREES)
    assert [path.name for path in tmp_path.iterdir()] == ["foreign.txt"]
