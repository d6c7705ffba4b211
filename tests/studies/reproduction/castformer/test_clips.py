"""Clips from end to end: those of a user, of which one class drives straight on, and those of our own motion."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

import cosim
from isac_cosim.evaluation.on_windows.maneuvers import maneuver_scores
from isac_cosim.evaluation.statistics import pooled
from isac_cosim.models.data.clips import load_clips
from isac_cosim.studies.reproduction.castformer.measured import MeasuredVariant, measured_of
from isac_cosim.studies.reproduction.castformer.motion_clips import (
    BACKGROUND,
    CLASSES,
    clip_streams,
    driving_count,
)
from isac_cosim.studies.reproduction.castformer.precision_recall import maneuvers_part
from isac_cosim.studies.reproduction.experiments.trainings import Scores
from isac_cosim.studies.reproduction.reproduce import Request, reproduce, request
from tests.models.data.test_clips import write
from tests.studies.reproduction import tiny
from tests.support.scripted import InlineEngine


def test_a_users_clips_are_scored_by_eq_13(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    folder, out = tmp_path / "clips", tmp_path / "out"
    folder.mkdir()
    write(folder, 20)
    arguments = ["reproduce", "castformer", "--clips", str(folder), "-o", str(out), "--stages", "data,horizon"]
    assert cosim.main([*arguments, "--dry-run"]) == 2
    assert "do not say which class drives straight on" in capfd.readouterr().err
    wanted = request("castformer", out, stages=["data", "horizon"], clips=folder, epochs=1, background="0")
    wanted = Request(**{**vars(wanted), "settings": wanted.settings.model_copy(update={"folds": 2})})
    page = reproduce(wanted, InlineEngine()).page.read_text()
    assert "Class 0 drives straight on" in page
    assert "predicted as background only" in page
    measured = measured_of(out, "horizon")[0]
    assert measured.background == 0
    with (out / "tables" / "precision_recall.csv").open(newline="") as file:
        shown = next(csv.DictReader(file))
    expected = maneuver_scores(pooled(measured.at(0)), 0)
    assert float(shown["precision"]) == pytest.approx(expected.precision, abs=1e-4)
    assert float(shown["recall"]) == pytest.approx(expected.recall, abs=1e-4)
    assert (shown["maneuvers"], shown["background"]) == ("16", "4")


def test_plain_driving_is_a_class_of_our_own_motion(tmp_path: Path) -> None:
    out = tmp_path / "out"
    size = tiny.castformer()
    result = reproduce(Request("castformer", "tiny", size, out, ["background"]), InlineEngine())
    clips = load_clips(out / "work" / "clips", CLASSES)
    by_class = np.bincount([clip.label for clip in clips], minlength=CLASSES)
    driving = driving_count(1, size.background_share)
    assert driving == 4
    assert by_class.tolist() == [4] * BACKGROUND + [4 * driving]
    assert {clip.background for clip in clips} == {BACKGROUND}
    assert {clip.inner.shape for clip in clips} == {(50, 6 * 4 + 1)}
    measured = measured_of(out, "background")[0]
    assert pooled(measured.at(0)).sum(axis=1).tolist() == by_class.tolist()
    assert "share of the background taken for a maneuver" in result.page.read_text()


def test_a_frame_holds_the_states_of_its_time() -> None:
    time_s = np.arange(2000) / 400
    tv = np.stack([100 + 20 * time_s, 3 + 0 * time_s, 20 + time_s, 0 * time_s, 1 + 0 * time_s, 0 * time_s])
    uv = tv[:, ::4] + np.array([30, 0, 0, 0, 0, 0])[:, None]
    inner, outer = clip_streams(tv, uv, 400.0, 100.0)
    assert inner.shape == (50, 241)
    assert outer.shape == (50, 61)
    np.testing.assert_allclose(inner[7, :40], 20 * time_s[280:320], rtol=1e-5)
    np.testing.assert_allclose(outer[7, :10], 30 + 20 * time_s[280:320:4], rtol=1e-5)
    np.testing.assert_allclose(inner[:, -1], 20 + time_s[39::40], rtol=1e-6)
    np.testing.assert_array_equal(inner[:, -1], outer[:, -1])


def test_without_a_background_the_page_says_so() -> None:
    folds = [Scores(name="", training_seed=0, counts={str(h): {"a": [[3, 1], [0, 4]]} for h in range(5)}, windows={})]
    part = maneuvers_part([MeasuredVariant("complete", "CaSTFormer", folds)])
    assert part is not None
    assert "FPP is 0" in part.text
    assert "recall, background only" not in part.rows[0]
