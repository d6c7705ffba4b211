"""Clip files: what is read, what is refused, which frames are taken, and that CaSTFormer learns from them."""

from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from isac_cosim.base.errors import InputError
from isac_cosim.models.data.clips import batch, frames, load_clips
from isac_cosim.models.predictors.castformer import CastformerCore, CastformerSettings, castformer_loss


def write(folder: Path, count: int = 20, classes: int = 5) -> None:
    """Clips of 12 to 30 frames, 65 and 33 wide; one feature of each stream carries the class."""
    rng = np.random.default_rng(0)
    for k in range(count):
        n = int(rng.integers(12, 31))
        inner, outer = rng.normal(size=(n, 65)), rng.normal(size=(n, 33))
        inner[:, k % classes] += 3
        outer[:, k % classes] += 3
        np.savez(folder / f"clip{k:02}.npz", **{"in": inner, "out": outer, "label": k % classes})


def test_clips_come_as_they_were_written(tmp_path: Path) -> None:
    write(tmp_path)
    clips = load_clips(tmp_path, 5)
    assert [clip.label for clip in clips] == [k % 5 for k in range(20)]
    with np.load(tmp_path / "clip07.npz") as stored:
        np.testing.assert_array_equal(clips[7].inner, stored["in"].astype(np.float32))
        np.testing.assert_array_equal(clips[7].outer, stored["out"].astype(np.float32))
    everything = batch(clips, 10)
    assert everything.inner.shape == (20, 10, 65)
    assert everything.outer.shape == (20, 10, 33)
    np.testing.assert_array_equal(everything.speed[:, :, 0], everything.outer[:, :, 32])


@settings(max_examples=50, deadline=None)
@given(count=st.integers(1, 200), length=st.integers(1, 60), seed=st.none() | st.integers(0, 9))
def test_one_frame_of_each_even_part(count: int, length: int, seed: int | None) -> None:
    taken = frames(count, length, None if seed is None else np.random.default_rng(seed))
    edges = np.arange(length + 1) * count / length
    assert (taken >= np.floor(edges[:-1])).all()
    assert (taken <= np.ceil(edges[1:]) - 1 + 1e-9).all()
    assert (np.diff(taken) >= 0).all()


def test_random_frames_depend_on_the_keys_and_the_clip_alone(tmp_path: Path) -> None:
    write(tmp_path, 4)
    clips = load_clips(tmp_path, 5)
    inner = batch(clips, 6, "train", 1).inner
    np.testing.assert_array_equal(batch(clips[::-1], 6, "train", 1).inner[::-1], inner)
    assert (batch(clips, 6, "train", 2).inner != inner).any()


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"label": 5}, "not a class"),
        ({"label": 1.5}, "not a class"),
        ({"label": np.array([1])}, "not a class"),
        ({"in": np.full((4, 65), np.nan)}, "in is not a table"),
        ({"out": np.zeros(4)}, "out is not a table"),
        ({"out": np.zeros((3, 33))}, "same frames"),
        ({"in": np.array([object()], dtype=object)}, "pickled"),
        ({"in": None}, "missing"),
        ({"background": 5}, "background 5 is not a class; give an integer from 0 to 4, or -1 for none"),
        ({"background": 0.0}, "background 0.0 is not a class"),
    ],
)
def test_other_files_are_refused(tmp_path: Path, changed: dict[str, object], message: str) -> None:
    content = {"in": np.zeros((4, 65)), "out": np.zeros((4, 33)), "label": 1} | changed
    np.savez(tmp_path / "a.npz", **{k: v for k, v in content.items() if v is not None})  # type: ignore[arg-type]
    with pytest.raises(InputError, match=message):
        load_clips(tmp_path, 5)


def test_folders_without_clips_and_clips_of_other_widths_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no \.npz"):
        load_clips(tmp_path, 5)
    write(tmp_path, 2)
    np.savez(tmp_path / "z.npz", **{"in": np.zeros((4, 64)), "out": np.zeros((4, 33)), "label": 1})
    with pytest.raises(InputError, match="64 and 33"):
        load_clips(tmp_path, 5)
    (tmp_path / "a.npz").write_text("no zip")
    with pytest.raises(InputError, match="not readable"):
        load_clips(tmp_path, 5)


def test_files_may_name_the_class_that_drives_straight_on(tmp_path: Path) -> None:
    content = {"in": np.zeros((4, 65)), "out": np.zeros((4, 33)), "label": 1}
    np.savez(tmp_path / "a.npz", **content, background=3)  # type: ignore[arg-type]
    assert load_clips(tmp_path, 5)[0].background == 3
    np.savez(tmp_path / "b.npz", **content)  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"b\.npz: background is not given, but 3 in a\.npz; say the same"):
        load_clips(tmp_path, 5)


def test_castformer_learns_from_clips(tmp_path: Path) -> None:
    write(tmp_path)
    clips = load_clips(tmp_path, 5)
    torch.manual_seed(0)
    net = CastformerCore(
        CastformerSettings(width=16, heads=4, encoder_layers=1, intent_source="out"), 5, 65, 33, speed=True
    )
    adam = torch.optim.Adam(net.parameters(), 3e-3)
    for epoch in range(25):
        data = batch(clips, 8, "train", epoch)
        streams = [torch.from_numpy(x) for x in (data.inner, data.outer, data.speed)]
        loss = castformer_loss(net.training_logits(*streams), torch.from_numpy(data.label), None, 0.1)
        adam.zero_grad()
        loss.backward()
        adam.step()
    data = batch(clips, 8)
    logits = net.eval()(*(torch.from_numpy(x) for x in (data.inner, data.outer, data.speed)))
    assert (logits.argmax(dim=1).numpy() == data.label).mean() > 0.8
