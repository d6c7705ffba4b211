"""What a page or a terminal shows of a result: a list of parts, each of which answers one question.

Evaluations on windows and in traffic, closed loops, sweeps and reproductions are all shown as such lists, which
`page` and `terminal` render. Which parts a result has: `registry`.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from math import isfinite
from pathlib import Path
from typing import Any, Protocol

from isac_cosim.base.files import replace_file
from isac_cosim.evaluation.report.html.charts import Chart
from isac_cosim.evaluation.report.replay.content import Replay
from isac_cosim.evaluation.statistics import Estimate

NO_VALUE = "-"
WHOLE_RANGES = ((0.0, 1.0), (-1.0, 1.0))
"""What a score can be, and a difference of two."""
MOST_BYTES = 5_000_000
"""Largest size of a table that is read again."""


@dataclass(frozen=True)
class Link:
    """A cell that leads to another page. target: its path, relative to this one."""

    text: str
    target: str


Cell = Estimate | Link | str | float | int | None
Row = Mapping[str, Cell]


@dataclass(frozen=True)
class Matrix:
    """A confusion matrix. counts: rows true, columns predicted. records: ids of those behind a cell, by row and column.

    replayed: ids of the records that the page's replay shows. most: ids that a cell lists.
    """

    classes: Sequence[str]
    counts: Sequence[Sequence[int]]
    records: Mapping[tuple[int, int], Sequence[str]] = field(default_factory=dict)
    replayed: Collection[str] = ()
    most: int = 60


@dataclass(frozen=True)
class Part:
    """The answer to one question, for people; what is empty is not shown.

    name: of the part, and of its CSV file where there is one. title, text: the question, and how to read the answer.
    numbers: figures that sum a result up, each with its name. rows: of a table; their keys are the headings. strong:
    numbers of the rows that sum the others up. sentences: what can be said. lines: of a list. figures: file names in
    the folder of the page's figures, each with a caption that says what it shows; missing ones are left out. seen:
    what there is to be seen in a figure, for those who do not see it, by its file name. figure_rows: the numbers
    behind a figure, by its file name. charts: how a page draws these numbers itself, by the figure's file name; the
    figure then stands where no script runs. bars: whether estimates from 0 to 1 are also drawn. folded: whether the
    table is behind its title on a page. matrix: who is taken for whom. replay: a road that moves; a page holds one.
    on_page, on_terminal: where the part is shown.
    """

    name: str
    title: str = ""
    text: str = ""
    rows: Sequence[Row] = ()
    figures: Sequence[tuple[str, str]] = ()
    numbers: Sequence[tuple[str, str]] = ()
    strong: Sequence[int] = ()
    sentences: Sequence[str] = ()
    lines: Sequence[str] = ()
    seen: Mapping[str, str] = field(default_factory=dict)
    figure_rows: Mapping[str, Sequence[Row]] = field(default_factory=dict)
    charts: Mapping[str, Chart] = field(default_factory=dict)
    bars: bool = False
    folded: bool = False
    matrix: Matrix | None = None
    replay: Replay | None = None
    on_page: bool = True
    on_terminal: bool = True

    @property
    def headings(self) -> list[str]:
        """The headings of the table's columns."""
        return list(dict.fromkeys(name for row in self.rows for name in row))


@dataclass(frozen=True)
class Shown:
    """A result that is to be shown.

    result: the content of `metrics.json`, typed. folder: where the figures lie; a part may draw one of its own there.
    remarks: sentences for captions, by the figure's file name. answers: what result parts of other packages measured,
    by the part's name (`evaluation.questions`). replay: of an episode of test records. confused: ids of the records
    behind each cell of the confusion matrix, by row and column.
    """

    result: Any
    folder: Path
    remarks: Mapping[str, str] = field(default_factory=dict)
    answers: Mapping[str, Any] = field(default_factory=dict)
    replay: Replay | None = None
    confused: Mapping[tuple[int, int], Sequence[str]] = field(default_factory=dict)


class ResultPart(Protocol):
    """A question about a result, and how its answer is shown."""

    @property
    def result_class(self) -> type:
        """The class of the results that it is asked of, such as `EvaluationResult` or `TrafficResult`."""

    def parts(self, shown: Shown) -> Sequence[Part]:
        """Return the answer; nothing where the result has none."""


def markdown(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table in Markdown.

    >>> print(markdown(["intention", "F1"], [["overtake", "0.93"]]))
    | intention | F1 |
    | --- | --- |
    | overtake | 0.93 |
    """
    return "\n".join(f"| {' | '.join(cells)} |" for cells in [list(head), ["---"] * len(head), *rows])


def text_of(cell: Cell) -> str:
    """Return a cell as people read it: an estimate with its spread over trainings and its interval."""
    if isinstance(cell, Estimate):
        if cell.value is None:
            return NO_VALUE
        spread = "" if cell.sd is None else f" ±{cell.sd:.3f}"
        over = "" if cell.over is None else f" over {cell.over[0]} of {cell.over[1]} intentions"
        return f"{cell.value:.3f}{spread}{interval_text(cell.low, cell.high)}{over}"
    if isinstance(cell, Link):
        return cell.text
    if cell is None:
        return NO_VALUE
    return f"{cell:.4g}" if isinstance(cell, float) else str(cell)


def interval_text(low: float | None, high: float | None, digits: int = 3, sign: str = "") -> str:
    """Return an interval to be put after its number; nothing where there is none or where it says nothing.

    It says nothing where it is a point, or all that a score or a difference of scores can be. digits: behind the point.
    sign: "+" to print the signs of both bounds.

    >>> interval_text(0.25, 0.75), interval_text(0.0, 1.0), interval_text(1.0, 1.0)
    (' (0.250 to 0.750)', '', '')
    """
    if low is None or high is None or low == high or (low, high) in WHOLE_RANGES:
        return ""
    return f" ({low:{sign}.{digits}f} to {high:{sign}.{digits}f})"


def texts_of(part: Part) -> list[list[str]]:
    """Return the rows of a part's table as people read them, a text for each heading."""
    return [[text_of(row.get(name)) for name in part.headings] for row in part.rows]


def counted(number: int, noun: str) -> str:
    """Return a number of things in words.

    >>> counted(1, "window"), counted(2, "window")
    ('1 window', '2 windows')
    """
    return f"{number} {noun}{'' if number == 1 else 's'}"


def csv_text(rows: Sequence[Row]) -> str:
    """Return rows as CSV; an estimate takes the columns of its value, its interval and its spread."""
    flat = [_flat(row) for row in rows]
    names = list(dict.fromkeys(name for row in flat for name in row))
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, names, restval="")
    writer.writeheader()
    writer.writerows(flat)
    return text.getvalue()


def write_table(rows: Sequence[Row], path: Path) -> None:
    """Write rows as CSV (`csv_text`). Raises OutputError."""
    content = csv_text(rows).encode("utf-8")
    replace_file(path, lambda partial: partial.write_bytes(content))


def read_table(path: Path) -> list[Row]:
    """Return the rows that `write_table` wrote, numbers as numbers; none where the file is missing or damaged."""
    try:
        if path.stat().st_size > MOST_BYTES:
            return []
        with path.open(encoding="utf-8", newline="") as file:
            return [{str(name): _cell(text) for name, text in row.items()} for row in csv.DictReader(file, strict=True)]
    except (OSError, ValueError, csv.Error):
        return []


def _cell(text: str | None) -> Cell:
    """Return a cell of a CSV file: a number where it is one, nothing where it is empty."""
    try:
        number = float(text or "nan")
    except (TypeError, ValueError):
        return str(text)
    return number if isfinite(number) else None


def _flat(row: Row) -> dict[str, str | float | int]:
    flat: dict[str, str | float | int] = {}
    for name, cell in row.items():
        if isinstance(cell, Estimate):
            numbers = {"": cell.value, " low": cell.low, " high": cell.high, " sd": cell.sd}
            if cell.over is not None:
                numbers[" over intentions"] = cell.over[0]
            flat |= {f"{name}{end}": "" if number is None else round(number, 6) for end, number in numbers.items()}
        else:
            flat[name] = cell.text if isinstance(cell, Link) else "" if cell is None else cell
    return flat
