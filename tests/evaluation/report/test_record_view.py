"""The drawing of a record: the look of its lines, and what is marked as before onset."""

from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from isac_cosim.evaluation.report import record_view
from isac_cosim.evaluation.report.record_view import BEFORE_ONSET, draw_record
from isac_cosim.evaluation.report.report import record_view as view_of
from isac_cosim.isacsim.scenarios.lane import Lane
from isac_cosim.isacsim.scenarios.scenario import Site
from isac_cosim.models.data.windows import Records
from isac_cosim.models.runs.run import Run


@pytest.fixture(scope="module")
def drawn(records: Records, network_run: Run, tmp_path_factory: pytest.TempPathFactory) -> Figure:
    """The figure of a record on a road of so many lanes that a cycle of line styles would have come round."""
    view = view_of(network_run, records, records.tv[1], 1)
    start = view.truth[:2, 0]
    lanes = [
        Lane(f"e_{k}", "e", k, 3.2, 900.0, start + np.array([[-300.0, 3.2 * k], [300.0, 3.2 * k]]), ())
        for k in range(-4, 5)
    ]
    figures: list[Figure] = []
    original = record_view.figure
    out = tmp_path_factory.mktemp("record") / "record.png"
    with pytest.MonkeyPatch.context() as patch:

        def kept(path: Path, width: float, height: float):
            return _Kept(original(path, width, height), figures)

        patch.setattr(record_view, "figure", kept)
        draw_record(view, lanes, [Site("s", 100, 20, 25, 0)], out)
    assert out.stat().st_size > 20_000
    return figures[0]


class _Kept:
    """A context of a figure that keeps the figure."""

    def __init__(self, context, figures: list[Figure]) -> None:
        self.context, self.figures = context, figures

    def __enter__(self) -> Figure:
        self.figures.append(self.context.__enter__())
        return self.figures[-1]

    def __exit__(self, *error: object) -> object:
        return self.context.__exit__(*error)


def test_true_and_sensed_are_solid_lines_of_their_own_colour(drawn: Figure) -> None:
    lines = [line for axes in drawn.axes for line in axes.lines]
    true = [line for line in lines if line.get_label() in ("true", "TV, true")]
    sensed = [line for line in lines if line.get_label() in ("sensed", "TV, sensed")]
    assert len(true) == len(sensed) == 7
    assert {line.get_linestyle() for line in (*true, *sensed)} == {"-"}
    (dark,), (coloured,) = ({line.get_color() for line in group} for group in (true, sensed))
    assert dark != coloured
    assert max(line.get_linewidth() for line in true) < min(line.get_linewidth() for line in sensed)
    assert all(line.get_zorder() > other.get_zorder() for line, other in zip(true, sensed, strict=True))


def test_the_time_before_onset_is_shaded_and_labelled(drawn: Figure) -> None:
    (axes,) = (axes for axes in drawn.axes if "end of the window" in axes.get_title(loc="left"))
    assert BEFORE_ONSET in [text.get_text() for text in axes.texts]
    (shade,) = axes.patches
    assert (shade.get_x(), shade.get_x() + shade.get_width()) == pytest.approx((-2.6, 0.0))
    named = [line for line in axes.lines if not line.get_label().startswith("_")]
    assert len(named) == 6
    assert all(min(line.get_xdata()) >= 0 for line in named)
