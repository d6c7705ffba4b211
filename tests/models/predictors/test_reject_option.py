"""The reject option: which windows it learns from, what it recognises, and how it is turned off."""

from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from isac_cosim.evaluation.on_windows.predictions import predict, unseen
from isac_cosim.labeling.intentions import Intention
from isac_cosim.models.data.pre_onset import PreOnsetSettings, has_pre_onset_windows, pre_onset_windows
from isac_cosim.models.data.windows import Records, WindowSettings, draw_ends, end_bounds
from isac_cosim.models.runs.run import REJECT_OPTION_FILE, Run
from isac_cosim.models.scores import open_set
from isac_cosim.models.training.training import train_records
from tests.support.made_up import MADE_OF, SMALL_RUN, make_records

TREES = SMALL_RUN.model_copy(update={"model": "trees"})


def test_pre_onset_windows_end_before_onset_whatever_training_windows_are_counted_from(records: Records) -> None:
    windows = WindowSettings(window_s=1.2, relative_to="commit", end_after_s=(-1, 0))
    moved = pre_onset_windows(windows, PreOnsetSettings())
    ends = draw_ends(records, moved, "test", per_record=3)
    before = records.table["t_onset"].to_numpy()[ends.row] - ends.times(records)
    assert before.min() >= 0.1 - 1e-6
    assert before.max() <= 0.6 + 1e-6
    assert moved.window_s == 1.2


def test_following_takes_no_part(records: Records, trees_run: Run, tmp_path: Path) -> None:
    following = records.label == Intention.FOLLOWING
    tv = records.tv.copy()
    tv[following] = np.random.default_rng(0).normal(0, 100, tv[following].shape)
    other = Records(tv, records.uv, records.tv_rate_hz, records.uv_rate_hz, records.table)
    run = train_records(other, MADE_OF, tmp_path / "run", TREES)
    left = unseen(records.take(~following), [trees_run])
    outputs = predict(trees_run, left, draw_ends(left, TREES.windows, "test")).outputs
    first, second = (open_set.of_run(trained)["pre_onset"](outputs) for trained in (trees_run, run))
    np.testing.assert_array_equal(first, second)


@pytest.mark.parametrize("kind", ["trees_run", "network_run"])
def test_it_separates_maneuvers_from_mere_driving(kind: str, records: Records, request: pytest.FixtureRequest) -> None:
    run: Run = request.getfixturevalue(kind)
    left = unseen(records, [run])
    late = WindowSettings.model_validate({**run.card.settings.windows.model_dump(), "end_after_s": (1.0, 2.2)})
    answered = predict(run, left, draw_ends(left, late, "test", per_record=4))
    value = open_set.of_run(run)["pre_onset"](answered.outputs)
    area = open_set.auroc(value[answered.known], value[answered.unknown])
    assert area is not None
    assert area > 0.85


def test_it_can_be_turned_off(records: Records, tmp_path: Path) -> None:
    settings = TREES.model_copy(update={"pre_onset": PreOnsetSettings(use=False)})
    run = train_records(records, MADE_OF, tmp_path / "run", settings)
    assert not (run.path / REJECT_OPTION_FILE).exists()
    assert set(open_set.of_run(run)) == set(open_set.SCORES) - {"pre_onset"} == set(run.card.validation_auroc)


def test_records_that_begin_too_late_have_none(tmp_path: Path) -> None:
    records = make_records(4, 1)
    windows = WindowSettings(window_s=2.6)
    assert not has_pre_onset_windows(records, windows, PreOnsetSettings())
    first, last = end_bounds(records, pre_onset_windows(WindowSettings(window_s=2.0), PreOnsetSettings()))
    assert (last >= first).all()
    run = train_records(records, MADE_OF, tmp_path / "run", TREES.model_copy(update={"windows": windows}))
    assert "pre_onset" not in open_set.of_run(run)


@pytest.mark.parametrize("ends", [(-0.1, -0.6), (-0.5, 0.2)])
def test_ends_that_are_no_range_before_onset_are_refused(ends: tuple[float, float]) -> None:
    with pytest.raises(ValidationError, match="end_after_onset_s"):
        PreOnsetSettings(end_after_onset_s=ends)
