"""Both reproductions from end to end, smaller than quick; the quick ones run with `pytest -m slow`."""

from __future__ import annotations

import json
import runpy
import shutil
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

import cosim
from isac_cosim.base.errors import InputError
from isac_cosim.base.feedback import SILENT
from isac_cosim.base.workers.engine import LocalEngine
from isac_cosim.benchmarks.findings.figures.pages import printed_tables
from isac_cosim.models.predictors.registry import PREDICTORS
from isac_cosim.studies.reproduction.asi_bip.results import DatasetResult, TrainingsResult
from isac_cosim.studies.reproduction.castformer.results import VariantsResult
from isac_cosim.studies.reproduction.experiments.sizes import AsiBipSize, CastformerSize
from isac_cosim.studies.reproduction.experiments.stages import (
    MARK,
    STAGES,
    Capacity,
    cost_in_words,
    cost_of,
    result_of,
)
from isac_cosim.studies.reproduction.reproduce import (
    PAPERS,
    Request,
    best_workers,
    expected_cost,
    reproduce,
    request,
)
from tests.studies.reproduction import tiny
from tests.support.recorded_feedback import RecordedFeedback
from tests.support.scripted import InlineEngine

DOCS = Path(cosim.__file__).parent / "docs"
ASI_BIP_STAGES = ("data", "isac", "isac-weather", "fig3", "fig4", "fig5", "fast")
CASTFORMER_STAGES = ("data", "horizon", "alpha", "compared")


def wanted(paper: str, size: AsiBipSize | CastformerSize, out: Path, stages: Sequence[str] | None) -> Request:
    return Request(paper, "tiny", size, out, stages)


@pytest.fixture(scope="module")
def asi_bip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("asi_bip") / "out"
    reproduce(wanted("asi-bip", tiny.asi_bip(), out, ASI_BIP_STAGES), InlineEngine())
    return out


@pytest.fixture(scope="module")
def castformer(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("castformer") / "out"
    reproduce(wanted("castformer", tiny.castformer(), out, CASTFORMER_STAGES), InlineEngine())
    return out


def test_asi_bip_leaves_tables_figures_and_a_page(asi_bip: Path) -> None:
    names = {"claims", "data", "table1", "fig3", "fig3_loss", "fig3_confusion", "fig4", "fig4_roc", "fig5", "fast"}
    assert {path.stem for path in (asi_bip / "tables").iterdir()} == names | {
        "fig4_confidence", "fig4_confusion", "counterparts",
    }  # fmt: skip
    figures = {path.name for path in (asi_bip / "figures").iterdir()}
    assert {"table1.png", "fig3_loss.png", "fig4_roc.png", "fig4_confidence.png", "fig5.png"} <= figures
    losses = (asi_bip / "tables" / "fig3_loss.csv").read_text().splitlines()
    assert [line.split(",")[:2] for line in losses] == [["training seed", "epoch"], ["0", "1"]]
    page = (asi_bip / "index.html").read_text()
    assert "Size tiny" in page
    assert "radar-nlos: Table I, onboard radar, NLoS" in page
    assert "of 26 claims, " in page
    assert (
        page.index("of 26 claims") < page.index(" in episode straight_road-") < page.index("Table I: ways of sensing")
    )
    assert len(json.loads((asi_bip / "claims.json").read_text())) == 26


def test_all_stages_of_asi_bip_share_the_predictors_and_their_windows(asi_bip: Path) -> None:
    table, fig3, fig5 = (result_of(asi_bip, stage, TrainingsResult) for stage in ("isac", "fig3", "fig5"))
    assert table is not None
    assert fig3 is not None
    assert fig5 is not None
    counts = table.trainings[0].counts["test"]
    assert fig3.trainings[0].counts["test"] == counts
    assert len(list((asi_bip / "work" / "runs" / "isac").iterdir())) == 1
    data = result_of(asi_bip, "data", DatasetResult)
    assert data is not None
    known = {side: part["known"] for side, part in data.samples.items()}
    assert np.sum(list(counts.values())) == known["test"]
    at_20_db = fig5.trainings[0].counts["20"]
    assert {group: np.sum(matrix) for group, matrix in at_20_db.items()} == {
        group: np.sum(matrix) for group, matrix in counts.items()
    }


def test_faster_trainings_are_those_of_isac_but_for_one_setting(asi_bip: Path) -> None:
    stage = result_of(asi_bip, "fast", TrainingsResult)
    assert stage is not None
    assert [training.name for training in stage.trainings] == [
        "fast-bfloat16, training seed 0", "fast-patches, training seed 0",
    ]  # fmt: skip
    runs = {run.parent.name: json.loads((run / "run.json").read_text()) for run in asi_bip.glob("work/runs/*/seed-0")}
    networks = {name: run["settings"]["asi_bip"] for name, run in runs.items() if name.startswith("isac")}
    plain = networks["isac"]
    changed = {name: {key for key in plain if network[key] != plain[key]} for name, network in networks.items()}
    assert changed == {"isac": set(), "isac-bfloat16": {"lstm_bfloat16"}, "isac-patches": {"tv_patch", "uv_patch"}}


def test_castformer_measures_every_horizon_on_every_seed(castformer: Path) -> None:
    horizon, alpha = (result_of(castformer, stage, VariantsResult) for stage in ("horizon", "alpha"))
    assert horizon is not None
    assert alpha is not None
    folds = horizon.variants[0].folds
    for horizon_s in "01234":
        tested = [group for fold in folds for group in fold.counts[horizon_s]]
        assert sorted(tested) == [f"straight_road-{seed}" for seed in (1, 2, 3, 4)]
    assert [row.name for row in alpha.variants] == ["complete"]
    assert alpha.variants[0].folds == folds
    assert "contradictions" in {path.stem for path in (castformer / "tables").iterdir()}


def test_a_finished_reproduction_is_not_run_again(castformer: Path) -> None:
    before = {path: path.stat().st_mtime_ns for path in (castformer / "stages").iterdir()}
    feedback = RecordedFeedback()
    result = reproduce(wanted("castformer", tiny.castformer(), castformer, CASTFORMER_STAGES), InlineEngine(), feedback)
    assert {path: path.stat().st_mtime_ns for path in (castformer / "stages").iterdir()} == before
    assert feedback.messages == ["every stage is finished; only the page is written"]
    assert result.not_run == ["ablation", "attention", "orders", "counterfactual", "repeat-1", "background"]


def finished_part(of: Path, stages: Sequence[str], out: Path) -> dict[Path, bytes]:
    """Copy what some stages of a reproduction left to a new folder, without datasets and runs; return its content."""
    (out / STAGES).mkdir(parents=True)
    for file in (Path(MARK), *(Path(STAGES) / f"{stage}.json" for stage in stages)):
        shutil.copyfile(of / file, out / file)
    return {path: path.read_bytes() for path in (out / STAGES).iterdir()}


def test_finished_stages_are_all_that_asi_bip_needs_to_go_on(asi_bip: Path, tmp_path: Path) -> None:
    before = finished_part(asi_bip, ("data", "isac", "fast"), tmp_path / "out")
    rest = wanted("asi-bip", tiny.asi_bip(), tmp_path / "out", ("isac", "fig3", "fast"))
    anew = expected_cost(rest, InlineEngine()).stages
    assert anew.keys() == {"fig3"}
    reproduce(rest, InlineEngine())
    assert {path: path.read_bytes() for path in before} == before
    there, here = (result_of(out, "fig3", TrainingsResult) for out in (asi_bip, tmp_path / "out"))
    assert there is not None
    assert here is not None
    assert [training.counts for training in here.trainings] == [training.counts for training in there.trainings]
    assert not (tmp_path / "out" / "work" / "runs" / "isac-patches").exists()


def test_finished_stages_are_all_that_castformer_needs_to_go_on(castformer: Path, tmp_path: Path) -> None:
    before = finished_part(castformer, ("data", "horizon"), tmp_path / "out")
    reproduce(wanted("castformer", tiny.castformer(), tmp_path / "out", ("horizon", "alpha")), InlineEngine())
    assert {path: path.read_bytes() for path in before} == before
    there, here = (result_of(out, "alpha", VariantsResult) for out in (castformer, tmp_path / "out"))
    assert there is not None
    assert here is not None
    assert [fold.counts for fold in here.variants[0].folds] == [fold.counts for fold in there.variants[0].folds]


def test_tables_of_a_part_say_only_what_is_measured(
    asi_bip: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Beside those of an earlier run that was finished; what says no more than they do is not said twice."""

    def printed_of(*folders: Path) -> dict[str, str]:
        script = str(DOCS / "reproduction_tables.py")
        monkeypatch.setattr("sys.argv", [script, *map(str, folders)])
        runpy.run_path(script, run_name="__main__")
        return printed_tables(capsys.readouterr().out)

    printed = printed_of(DOCS / "reproduction" / "asi-bip", asi_bip)
    assert {"Table I", "Table I in the present preset", "Fig. 4 in the present preset"} <= printed.keys()
    assert "Fig. 4" not in printed
    assert "Samples" in printed
    assert "Where each figure and table is in the present preset" not in printed
    assert "| undecided | - |" in printed_of(asi_bip)["What the paper claims"]
    assert "| undecided | - |" not in printed["What the paper claims in the present preset"]


def test_clips_take_the_place_of_windows(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    (tmp_path / "clips").mkdir()
    for k in range(20):
        streams = {"in": rng.normal(size=(15, 5)) + k % 5, "out": rng.normal(size=(15, 3)), "label": np.int64(k % 5)}
        np.savez(tmp_path / "clips" / f"clip{k:02}.npz", **streams)
    size = tiny.castformer(training={"optimiser": {"epochs": 1}})
    asked = Request("castformer", "tiny", size, tmp_path / "out", ("data", "horizon"), tmp_path / "clips", "0")
    result = reproduce(asked, InlineEngine())
    stage = result_of(tmp_path / "out", "horizon", VariantsResult)
    assert stage is not None
    assert stage.source == "clips"
    counts = [fold.counts["4"] for fold in stage.variants[0].folds]
    assert sum(np.sum(matrix) for fold in counts for matrix in fold.values()) == 20
    assert "compared" not in result.not_run


def test_the_full_run_states_its_cost(tmp_path: Path) -> None:
    for paper in PAPERS:
        asked = request(paper, tmp_path / "out")
        workers = best_workers(asked, 2)
        assert workers == 3
        cost = cost_of(asked.reproduction(InlineEngine(), SILENT).stages(), asked.out, Capacity(workers, 2))
        assert cost.seconds <= 10 * 3600
        assert max(cost.stages.values()) <= 3600
        assert "with 3 workers on 2 cores" in cost_in_words(cost)


@pytest.mark.parametrize(
    ("paper", "first", "later"),
    [("asi-bip", "isac", "fig3"), ("asi-bip", "isac", "isac-weather"), ("castformer", "ablation", "attention")],
)
def test_a_stage_alone_costs_what_another_one_would_have_made(
    paper: str, first: str, later: str, tmp_path: Path
) -> None:
    def cpu_s(*stages: str) -> float:
        return expected_cost(request(paper, tmp_path / "out", stages=stages), LocalEngine(2)).cpu_s

    shared = cpu_s(first) + cpu_s(later) - cpu_s(first, later)
    assert cpu_s(later) > shared > 0.2 * cpu_s(later)


def test_wrong_requests_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="choose asi-bip or castformer"):
        request("lstm", tmp_path)
    with pytest.raises(InputError, match="--clips applies to castformer only"):
        request("asi-bip", tmp_path, clips=tmp_path)
    with pytest.raises(InputError, match="no such folder"):
        expected_cost(request("castformer", tmp_path, clips=tmp_path / "nowhere"), LocalEngine(1))


def test_a_missing_package_is_reported_before_any_stage_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(PREDICTORS["minirocket"], "optional_packages", {"no_such_package": "pip install it"})
    with pytest.raises(InputError, match="no_such_package: pip install it"):
        reproduce(request("castformer", tmp_path / "out", stages=["data", "compared"]), InlineEngine())
    assert not (tmp_path / "out").exists()


def test_epochs_replace_those_of_the_size(tmp_path: Path) -> None:
    asked = request("asi-bip", tmp_path, epochs=3)
    assert asked.settings.training["optimiser"] == {"epochs": 3, "patience": 3}
    assert asked.settings.model_dump()["literal_epochs"] == 3


@pytest.mark.slow
@pytest.mark.parametrize("paper", PAPERS)
def test_the_quick_reproduction_runs_every_stage(paper: str, tmp_path: Path) -> None:
    result = reproduce(request(paper, tmp_path / "out", quick=True), LocalEngine(2))
    assert result.not_run == []
    assert {claim.verdict for claim in result.claims} <= {"holds", "does not hold", "undecided"}
    assert "Size quick" in result.page.read_text()
