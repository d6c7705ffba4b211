"""From a dataset on disk to the report: the functions that the command line calls."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest
from made_up import SMALL_RUN, make_records
from rich.console import Console

from isacsim.errors import InputError
from isacsim.recording import Lane
from labeling.dataset import (
    Dataset,
    Episode,
    Meta,
    Sample,
    ScenarioMeta,
    SiteMeta,
    write_meta,
    write_roads,
    write_shard,
)
from labeling.intentions import Intention
from models.evaluation import EvaluateSettings, evaluate
from models.report import write_report
from models.training import train

TREES = SMALL_RUN.model_copy(update={"model": "trees"})
SITE = SiteMeta(id="s", x=1.0, y=2.0, height_m=25.0, azimuth_deg=90.0)


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    """The made-up records of four seeds, on disk."""
    folder = tmp_path_factory.mktemp("made_up") / "data"
    (folder / "shards").mkdir(parents=True)
    records = make_records(4, 2)
    table, shards = records.table, []
    for seed in range(4):
        rows = [
            Sample(
                row.sample_id,
                "toy",
                seed,
                "kinematic",
                "tv",
                "uv",
                Intention(row.label),
                "natural",
                row.t_start,
                row.t_onset,
                row.t_commit,
                row.t_commit + 1,
                "isac",
                row.snr_db,
                4,
                records.tv[row.Index],
                records.tv[row.Index] + np.float32(0.1),
                records.uv[row.Index],
            )
            for row in table[table["seed"] == seed].itertuples()
        ]
        shards.append(write_shard(folder / "shards", rows, Episode(scenario="toy", seed=seed), 2000, 500))
    scenario = ScenarioMeta(name="toy", source="toy", sha256="0" * 64, origin=(0.0, 0.0), sites=(SITE,))
    meta = Meta(
        complete=True, fingerprint="f", tv_rate_hz=400, uv_rate_hz=100, duration_s=5.0, study={"seeds": [0, 3]},
        versions={}, scenarios=(scenario,), shards=tuple(shards),
    )  # fmt: skip
    write_meta(folder, meta)
    write_roads(folder, "toy", [Lane("e_0", "e", 0, 3.2, 900.0, np.array([[0.0, 0.0], [900.0, 0.0]]), ())])
    return Dataset.open(folder)


def test_train_evaluate_report(dataset: Dataset, tmp_path: Path) -> None:
    run = train(dataset, tmp_path / "run", TREES)
    assert run.card.dataset == {"digest": dataset.digest, "study": {"seeds": [0, 3]}}
    found = evaluate(run, dataset, tmp_path / "report", EvaluateSettings(ends_per_record=1))
    assert found["made_by"]["dataset"]["digest"] == dataset.digest
    page = write_report(run, dataset, tmp_path / "report")
    assert page.name == "index.html"
    assert {path.name for path in page.parent.glob("*.png")} == {
        "confusion.png", "lead_time.png", "unknown_roc.png", "record.png",
    }  # fmt: skip


def test_a_report_needs_metrics(dataset: Dataset, tmp_path: Path) -> None:
    run = train(dataset, tmp_path / "run", TREES)
    with pytest.raises(InputError, match=r"metrics\.json"):
        write_report(run, dataset, tmp_path / "nothing")


def test_progress_is_drawn_where_it_is_asked_for(
    dataset: Dataset, tmp_path: Path, capfd: pytest.CaptureFixture
) -> None:
    console = Console(file=io.StringIO(), force_terminal=True, width=120)
    short = SMALL_RUN.model_copy(update={"optimiser": SMALL_RUN.optimiser.model_copy(update={"epochs": 1})})
    train(dataset, tmp_path / "run", short, console)
    drawn = console.file.getvalue()  # type: ignore[attr-defined]
    assert "epoch 1/1" in drawn
    assert "left" in drawn
    # Lightning's own remarks stay away.
    assert capfd.readouterr() == ("", "")
