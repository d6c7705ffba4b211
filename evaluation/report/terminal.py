"""Parts of a result on the terminal: tables and sentences."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from itertools import groupby

from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

from isac_cosim.base.progress import UNBOUND, print_line
from isac_cosim.evaluation.report.parts import Part, texts_of

NUMBER = re.compile(r"[-+±]?[\d.]|-?$")
"""How the text of a number begins."""


def show(parts: Sequence[Part], console: Console, title: str = "", whole: bool = False) -> None:
    """Print parts. Those with a table of the same headings, one after the other, share one table.

    title: of the first table. whole: whether tables are printed as wide as they are where the terminal is narrower. In
    a file or a pipe, they always are.
    """
    shown = [part for part in parts if part.on_terminal]
    width = console.width
    if whole or not console.is_terminal:
        console.width = UNBOUND
    for drawn in tables(shown, title):
        console.print(drawn)
    console.width = width
    for part in shown:
        for line in (*part.sentences, *part.lines):
            print_line(console, line)


def tables(parts: Sequence[Part], title: str = "") -> Iterator[Table]:
    """Yield the tables of parts; title: of the first one. A part with a title is a section under it."""
    with_rows = [part for part in parts if part.rows]
    for headings, group in groupby(with_rows, lambda part: part.headings):
        alike = list(group)
        # A table of one part has the part's title for its own.
        single = not title and len(alike) == 1
        drawn = Table(title=alike[0].title if single else title, title_justify="left", box=box.HEAVY_HEAD)
        title = ""
        texts = [row for part in alike for row in texts_of(part)]
        for k, heading in enumerate(headings):
            numbers = k > 0 and all(NUMBER.match(row[k]) for row in texts)
            drawn.add_column(heading, justify="right" if numbers else "left", no_wrap=k == 0 and len(headings) > 4)
        for part in alike:
            titled = bool(part.title) and not single
            if titled:
                drawn.add_row(Text(part.title, "bold"), *("" for _ in headings[1:]))
            for row in texts_of(part):
                drawn.add_row(*map(Text, (f"  {row[0]}" if titled else row[0], *row[1:])))
            drawn.add_section()
        yield drawn
