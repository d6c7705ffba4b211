"""What a CaSTFormer looked at: means by intention, and a figure of one record."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from isac_cosim.base.arrays import Array
from isac_cosim.evaluation.on_windows.results import EvaluationResult
from isac_cosim.evaluation.report.figures import BESIDE, GREY, figure
from isac_cosim.evaluation.report.parts import Cell, Part, Row, Shown
from isac_cosim.labeling.intentions import spoken
from isac_cosim.models.networks.castformer_inspection import BRANCHES, STREAMS, Inspection

FIGURE = "explained.png"
CAPTION = (
    "One record: above, how much the last frame of each window attends to earlier frames of the other stream, by their "
    "age; below, the gates of CPE, the length of its gated residuals over that of the stream, and the weights of FSN."
)
HEADINGS = {
    "age_s": "attends to, s before the end: {}",
    "gate": "gate: {}",
    "residual": "residual: {}",
    "weight": "weight: {}",
}
TEXT = (
    "Means over the windows of each intention, 95 % intervals over the scenario seeds. `in` is the TV's stream, `out` "
    "the UV's. RSF: mean age of the frames that the last frame attends to. CPE: gate of Eq. (8), and length of the "
    "gated residual over that of the stream that it is added to. FSN: weights of the branches, Eq. (11), which sum to "
    "1. What a module attends to is no proof of what causes the answer."
)


@dataclass(frozen=True)
class ExplainedRecord:
    """What the modules do along a record.

    title: of the record. t_end: ends of the n windows, s after onset, (n,). commit_s: time of the commit, s after
    onset. seen: of these windows. frame_s: length of a frame, s.
    """

    title: str
    t_end: Array
    commit_s: float
    seen: Inspection
    frame_s: float


class Explained:
    """The means by intention, and the figure of a record."""

    result_class = EvaluationResult

    def parts(self, shown: Shown) -> list[Part]:
        """Return the table and the figure; nothing where it was not asked for."""
        result: EvaluationResult = shown.result
        rows: list[Row] = []
        for name, means in (result.explained or {}).items():
            row: dict[str, Cell] = {"intention": spoken(name), "windows": means.n}
            for kind, heading in HEADINGS.items():
                row |= {heading.format(column): value for column, value in getattr(means, kind).items()}
            rows.append(row)
        return [Part("explained", "What the network looks at", TEXT, rows, [(FIGURE, CAPTION)])] if rows else []


def draw_explained(record: ExplainedRecord, path: Path) -> None:
    """Draw what the modules do along a record as a PNG: a row for each module that is on."""
    seen = record.seen
    curves = [
        (title, columns, values)
        for title, columns, values in (
            ("gate of CPE", STREAMS, seen.gate),
            ("residual of CPE over stream", STREAMS, seen.residual),
            ("weight of FSN", BRANCHES, seen.weight),
        )
        if values is not None
    ]
    maps = 0 if seen.attention is None else len(STREAMS)
    with figure(path, 9, 1.0 + 1.7 * (maps + len(curves))) as drawn:
        rows = drawn.subplots(maps + len(curves), 1, sharex=True, squeeze=False)[:, 0]
        for k in range(maps):
            assert seen.attention is not None
            ages = record.frame_s * (np.arange(seen.attention.shape[2] + 1) - 0.5)
            edges = _edges(record.t_end)
            mesh = rows[k].pcolormesh(edges, ages, seen.attention[:, k].T, cmap="Blues", vmin=0, rasterized=True)
            rows[k].set(ylabel="age, s")
            rows[k].set_title(f"RSF: attention of `{STREAMS[k]}`")
            drawn.colorbar(mesh, ax=rows[k], label="weight")
        for axes, (title, columns, values) in zip(rows[maps:], curves, strict=True):
            for k, column in enumerate(columns):
                axes.plot(record.t_end, values[:, k], label=column)
            axes.set_title(title)
            axes.set_ylim(0, 1 if columns is BRANCHES or "gate" in title else None)
            axes.legend(**BESIDE)
        for axes in rows:
            for instant in (0.0, record.commit_s):
                axes.axvline(instant, color=GREY, ls="--", lw=1)
        rows[-1].set_xlabel("end of the window, s after onset; dashed: onset and commit")
        drawn.suptitle(record.title, x=0.01, ha="left", fontweight="bold")


def _edges(centres: Array) -> Array:
    """Return the bounds of even bins around centres, (n + 1,)."""
    half = 0.5 * float(np.median(np.diff(centres))) if len(centres) > 1 else 0.5
    return np.concatenate([centres - half, centres[-1:] + half])
