"""Variation of training windows: what it keeps, what it changes, and that training uses it."""

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from isac_cosim.base.seeding import stream
from isac_cosim.labeling.intentions import Intention
from isac_cosim.models.data.augment import AugmentSettings, augmented, mirrored, mirrored_labels, turned
from isac_cosim.models.data.windows import Records, Windows, WindowSettings
from isac_cosim.models.runs.settings import TrainSettings
from isac_cosim.models.training.training import train_records
from tests.support.made_up import MADE_OF, SMALL_RUN


def some(count: int = 60, seed: int = 0) -> tuple[Windows, np.ndarray]:
    rng = np.random.default_rng(seed)
    tv, uv = (rng.normal(size=(count, 6, n)).astype(np.float32) for n in (40, 10))
    return Windows(tv, uv), np.arange(count) % 6


def test_mirrored_twice_is_the_window_itself() -> None:
    windows, label = some()
    np.testing.assert_array_equal(mirrored(mirrored(windows.tv)), windows.tv)
    np.testing.assert_array_equal(mirrored_labels(mirrored_labels(label)), label)


def test_the_mirror_swaps_sides_and_labels_and_leaves_overtakes() -> None:
    windows, label = some()
    changed, changed_label = augmented(windows, label, AugmentSettings(mirror_share=1), stream("test"))
    overtake = label == Intention.OVERTAKE
    for before, after in ((windows.tv, changed.tv), (windows.uv, changed.uv)):
        np.testing.assert_array_equal(after[:, ::2], before[:, ::2])
        np.testing.assert_array_equal(after[~overtake, 1::2], -before[~overtake, 1::2])
        np.testing.assert_array_equal(after[overtake], before[overtake])
    assert set(zip(label.tolist(), changed_label.tolist(), strict=True)) == {
        (0, 0),
        (1, 2),
        (2, 1),
        (3, 3),
        (4, 4),
        (5, 5),
    }


def test_about_the_asked_share_is_mirrored() -> None:
    windows, _ = some(2000)
    label = np.full(2000, Intention.LEFT_LANE_CHANGE)
    _, changed_label = augmented(windows, label, AugmentSettings(mirror_share=0.3), stream("test"))
    assert (changed_label == Intention.RIGHT_LANE_CHANGE).mean() == pytest.approx(0.3, abs=0.04)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 1000), st.floats(0.1, 45))
def test_a_turn_keeps_lengths_and_what_both_streams_are_to_each_other(seed: int, degrees: float) -> None:
    windows, label = some(5, seed)
    changed, changed_label = augmented(windows, label, AugmentSettings(turn_deg=degrees), stream("test", seed))
    np.testing.assert_array_equal(changed_label, label)
    for part in (slice(0, 2), slice(2, 4), slice(4, 6)):
        for before, after in ((windows.tv, changed.tv), (windows.uv, changed.uv)):
            expected = np.linalg.norm(before[:, part], axis=1)
            np.testing.assert_allclose(np.linalg.norm(after[:, part], axis=1), expected, atol=1e-5)
        inner = [(w.tv[:, part, 0] * w.uv[:, part, 0]).sum(axis=1) for w in (windows, changed)]
        np.testing.assert_allclose(inner[0], inner[1], atol=1e-5)


def test_a_quarter_turn_takes_x_to_y() -> None:
    states = np.zeros((1, 6, 1), np.float32)
    states[0, [0, 3]] = 2
    after = turned(states, np.array([np.pi / 2]))
    np.testing.assert_allclose(after[0, :, 0], [0, 2, -2, 0, 0, 0], atol=1e-6)


def test_noise_is_on_the_tv_and_of_the_asked_size() -> None:
    windows, label = some(400)
    noisy = AugmentSettings(noise_m=0.5, noise_mps=0.2)
    noisy_windows, _ = augmented(windows, label, noisy, stream("test"))
    np.testing.assert_array_equal(noisy_windows.uv, windows.uv)
    added = (noisy_windows.tv - windows.tv).std(axis=(0, 2))
    np.testing.assert_allclose(added, [0.5, 0.5, 0.2, 0.2, 0, 0], rtol=0.03, atol=1e-6)


def test_turning_an_absolute_frame_is_refused() -> None:
    with pytest.raises(ValidationError, match="absolute"):
        TrainSettings(windows=WindowSettings(frame="absolute"), augment=AugmentSettings(turn_deg=3))
    assert TrainSettings(windows=WindowSettings(frame="absolute"), augment=AugmentSettings(noise_m=0.1)).augment.noise_m


@pytest.mark.slow
def test_training_sees_varied_windows_and_repeats_itself(records: Records, tmp_path) -> None:  # type: ignore[no-untyped-def]
    one = SMALL_RUN.optimiser.model_copy(update={"epochs": 1})
    plain = SMALL_RUN.model_copy(update={"optimiser": one})
    varied = plain.model_copy(update={"augment": AugmentSettings(turn_deg=5, noise_mps=0.2, mirror_share=0.5)})
    loss = []
    for k, training in enumerate((plain, varied, varied)):
        run = train_records(records, MADE_OF, tmp_path / str(k), training)
        loss.append(pd.read_csv(run.path / "history.csv")["train_loss"][0])
    assert loss[0] != loss[1] == loss[2]
