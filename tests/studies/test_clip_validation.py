"""Cross-validation on clips: folds, standardisation by the training clips alone, and a network that learns."""

from dataclasses import replace

import numpy as np
import pytest
from pydantic import ValidationError

from isac_cosim.base.errors import InputError, RunError
from isac_cosim.models.data.clips import Clip
from isac_cosim.models.predictors.castformer import CastformerSettings
from isac_cosim.studies.clip_validation import (
    ClipSettings,
    background_of,
    cross_validate,
    folds,
    predict_fold,
    standardised,
)

SMALL = ClipSettings(
    castformer=CastformerSettings(width=16, heads=4, encoder_layers=1, dropout=0, intent_source="out"),
    frames=6, folds=5, epochs=6, batch=8, learning_rate=5e-3, background=0,
)  # fmt: skip


def clips(count: int = 50, classes: int = 5) -> list[Clip]:
    """Clips of 8 to 15 frames, 65 and 33 wide; one feature of each stream carries the class."""
    rng = np.random.default_rng(0)
    drawn = []
    for k in range(count):
        n = int(rng.integers(8, 16))
        inner, outer = rng.normal(5, 2, (n, 65)), rng.normal(-3, 4, (n, 33))
        inner[:, k % classes] += 8
        outer[:, k % classes] += 16
        drawn.append(Clip(f"clip{k:02}", inner.astype(np.float32), outer.astype(np.float32), k % classes))
    return drawn


def test_every_clip_is_held_out_once_and_classes_are_even() -> None:
    label = np.array([clip.label for clip in clips()])
    parts = folds(label, SMALL)
    assert sorted(np.concatenate([test for _, test in parts])) == list(range(50))
    for train, test in parts:
        assert not set(train) & set(test)
        assert np.bincount(label[test]).tolist() == [2] * 5
    assert any(
        (a[1] != b[1]).any() for a, b in zip(parts, folds(label, SMALL.model_copy(update={"seed": 1})), strict=True)
    )


def test_features_are_scaled_by_the_training_clips_alone() -> None:
    training, held_out = clips(20)[:15], clips(20)[15:]
    frames = np.concatenate([clip.inner for clip in standardised(training, training)])
    np.testing.assert_allclose(frames.mean(axis=0), 0, atol=1e-4)
    np.testing.assert_allclose(frames.std(axis=0), 1, atol=1e-4)
    moved = [replace(clip, inner=clip.inner + 100) for clip in held_out]
    apart = standardised(training, moved)[0].inner - standardised(training, held_out)[0].inner
    scale = np.concatenate([clip.inner for clip in training]).std(axis=0)
    np.testing.assert_allclose(apart, np.broadcast_to(100 / scale, apart.shape), rtol=1e-3)


@pytest.mark.slow
def test_castformer_is_measured_on_clips_it_was_not_trained_on() -> None:
    result = cross_validate(clips(), SMALL)
    assert [fold.n for fold in result.folds] == [10] * 5
    counts = np.array(result.confusion)
    assert counts.sum(axis=1).tolist() == [10] * 5
    assert result.accuracy_of_all == pytest.approx(np.trace(counts) / 50)
    assert result.accuracy.mean == pytest.approx(np.mean([fold.accuracy for fold in result.folds]))
    assert result.accuracy.n == 5
    assert result.f1.mean is not None
    assert result.f1.mean > 0.8


def test_shuffled_labels_are_not_learnt() -> None:
    rng = np.random.default_rng(1)
    shuffled = [replace(clip, label=int(k)) for clip, k in zip(clips(), rng.permutation(50) % 5, strict=True)]
    assert cross_validate(shuffled, SMALL.model_copy(update={"folds": 2})).accuracy_of_all < 0.45


def test_a_fold_is_the_same_each_time() -> None:
    drawn = clips(25)
    settings = SMALL.model_copy(update={"epochs": 1})
    np.testing.assert_array_equal(*(predict_fold(drawn[:20], drawn[20:], settings, 0) for _ in range(2)))


def test_too_few_clips_are_refused() -> None:
    with pytest.raises(InputError, match="too few for 5 folds"):
        cross_validate(clips(15), SMALL)


def test_a_training_on_clips_that_diverges_ends_in_one_line() -> None:
    wild = SMALL.model_copy(update={"learning_rate": 1e30})
    with pytest.raises(
        RunError, match=r"clips: a loss in epoch \d of fold 1 is (nan|inf), .* lower learning_rate, now 1e\+30"
    ):
        predict_fold(clips(20)[:15], clips(20)[15:], wild, 0)


def test_the_class_that_drives_straight_on_is_never_silently_absent() -> None:
    silent = clips(2)
    with pytest.raises(InputError, match=r"do not say which class drives straight on.*--background none"):
        background_of(silent, None)
    with pytest.raises(ValidationError, match="background"):
        ClipSettings()  # type: ignore[call-arg]
    assert background_of(silent, "2") == 2
    assert background_of(silent, "none") is None
    stored = [replace(clip, background=4) for clip in silent]
    assert background_of(stored, None) == background_of(stored, "4") == 4
    assert background_of([replace(silent[0], background=-1)], None) is None


@pytest.mark.parametrize("stated", ["5", "-1", "straight", "", "1.0", "\u0663"])
def test_a_background_that_is_no_class_is_refused(stated: str) -> None:
    with pytest.raises(InputError, match="give a class from 0 to 4, or none"):
        background_of(clips(1), stated)


def test_a_background_against_the_files_is_refused() -> None:
    with pytest.raises(InputError, match="--background 1: the files of the clips say 4"):
        background_of([replace(clip, background=4) for clip in clips(1)], "1")
