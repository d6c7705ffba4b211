"""Our own motion in the form of the paper's clips: 5 s before the commit, and as many of plain driving as it has.

The tables on windows know maneuvers only, so nothing is ever predicted on the background: FPP of Eq. (13) is 0 there.
Here `following` is the background, a class that the network is trained on, as driving straight on is in Brain4Cars.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from isac_cosim.base.arrays import Array, Float32Array
from isac_cosim.labeling.dataset.dataset import Dataset
from isac_cosim.labeling.intentions import Intention
from isac_cosim.models.data.windows import Records, WindowSettings, cut, draw_ends
from isac_cosim.studies.reproduction.castformer.clips import CLIP_S

FRAME_S = 0.1
"""Length of a frame, s: that of CaSTFormer on windows."""
CLASSES = len(Intention)
BACKGROUND = int(Intention.FOLLOWING)
BATCH = 64


def driving_count(per_class: int, share: float) -> int:
    """Return how many clips of plain driving go with `per_class` of each of the six intentions, for a share of all."""
    return round(share / (1 - share) * (CLASSES - 1) * per_class)


def write_clips(datasets: list[Dataset], folder: Path) -> dict[str, list[str]]:
    """Write a clip for each record that holds the 5 s before its commit; return their names by scenario seed.

    A frame of `in` holds the TV's states of 100 ms, one of `out` the UV's, relative to the TV's first position; the
    TV's speed is appended to both. Samples of two datasets may share an identifier, so a clip's name begins with the
    number of its dataset. Clips of earlier calls are replaced.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for file in folder.glob("*.npz"):
        file.unlink()
    settings = WindowSettings(window_s=CLIP_S, relative_to="commit", end_after_s=(0.0, 0.0), frame="absolute")
    by_group: dict[str, list[str]] = {}
    for number, dataset in enumerate(datasets):
        records = Records.of(dataset)
        ends = draw_ends(records, settings, "clips")
        names = [f"{number}-{identifier}" for identifier in records.table["sample_id"]]
        for start in range(0, len(ends), BATCH):
            part = ends[start : start + BATCH]
            windows = cut(records, part, settings)
            for row, tv, uv in zip(part.row, windows.tv, windows.uv, strict=True):
                inner, outer = clip_streams(tv, uv, records.tv_rate_hz, records.uv_rate_hz)
                label = int(records.label[row])
                arrays: dict[str, Any] = {"in": inner, "out": outer, "label": label, "background": BACKGROUND}
                np.savez(folder / f"{names[row]}.npz", **arrays)
                by_group.setdefault(str(records.groups[row]), []).append(str(names[row]))
    return {group: sorted(names) for group, names in sorted(by_group.items())}


def clip_streams(tv: Array, uv: Array, tv_rate_hz: float, uv_rate_hz: float) -> tuple[Float32Array, Float32Array]:
    """Return the frames of both streams, (T, W) and (T, V), of states (6, n) and (6, m) in the scenario's plane."""
    origin = np.concatenate([tv[:2, :1], np.zeros((4, 1))])
    size = round(FRAME_S * tv_rate_hz), round(FRAME_S * uv_rate_hz)
    count = min(tv.shape[1] // size[0], uv.shape[1] // size[1])
    inner, outer = (
        (states - origin)[:, -count * n :].reshape(6, count, n).transpose(1, 0, 2).reshape(count, 6 * n)
        for states, n in ((tv, size[0]), (uv, size[1]))
    )
    speed = np.hypot(tv[2], tv[3])[-1 :: -size[0]][:count][::-1][:, None]
    return np.hstack([inner, speed]).astype(np.float32), np.hstack([outer, speed]).astype(np.float32)
