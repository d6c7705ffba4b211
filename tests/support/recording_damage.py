"""What may happen to a file of trajectories: bytes that change, and values, names, rows and columns of its tables."""

from __future__ import annotations

import re
from pathlib import Path
from random import Random

from tests.support.damage import changed, table_changed
from tests.support.mutations import ODD_NUMBERS

CELLS = (
    "", "nan", "inf", "-1", "1e999", "x", "0", "1,2", "ü", "../x", "9" * 40, "0.5", "1e6", "-1e6", '"', '"a', "null",
    *map(str, ODD_NUMBERS),
)  # fmt: skip


def damage_recording(path: Path, random: Random) -> str:
    """Change a file of trajectories, its meta files or its map in one way or more, and return what was done."""
    by_content = {".parquet": table_changed, ".xml": xml_changed, ".osm": xml_changed}.get(path.suffix, cells_changed)
    return changed(path, random, by_content)


def xml_changed(path: Path, random: Random) -> str:
    """Change an attribute, or leave out, repeat or move a line."""
    text = path.read_text()
    kind = random.choice(("attribute", "attribute", "attribute", "name", "all", "lines"))
    if kind == "lines":
        return _lines_changed(path, random)
    found = list(re.finditer(r" (\w+)=([\"'])([^\"']*)\2", text))
    match = random.choice(found)
    name, value = match[1], _odd(match[3], random)
    if kind == "all":
        text = re.sub(rf" {name}=([\"'])[^\"']*\1", f' {name}="{value}"', text)
    else:
        new = f' {name}="{value}"' if kind == "attribute" else f' {random.choice(("a", "id", "x", "lat"))}="{match[3]}"'
        text = text[: match.start()] + new + text[match.end() :]
    path.write_text(text)
    return f"{kind} {name}: {match[3]} is {value[:20]}"


def cells_changed(path: Path, random: Random) -> str:
    """Change a value of a table, all values of a column, a name of its header, or rows."""
    kind = random.choice(("one", "one", "one", "column", "column", "header", "drop", "lines", "lines", "delimiter"))
    if kind == "lines":
        return _lines_changed(path, random)
    lines = path.read_text().splitlines()
    delimiter = max(";", ",", " ", key=lines[0].count)
    rows = [line.split(delimiter) for line in lines]
    column, row = random.randrange(len(rows[0])), random.randrange(len(rows))
    named = rows[0][column]
    if kind == "one":
        rows[row][column] = _odd(rows[row][column], random)
    elif kind == "header":
        rows[0][column] = random.choice(("", "x", rows[0][0], named.upper(), f" {named}"))
    elif kind == "delimiter":
        delimiter = random.choice((";", ",", "\t", " "))
    elif kind == "drop":
        rows = [[*cells[:column], *cells[column + 1 :]] for cells in rows]
    else:
        old = rows[min(1, len(rows) - 1)][column]
        new = _odd(old, random)
        factor = random.choice((0.0, -1.0, 0.3048, 3.28084, 1000.0))
        for cells in rows[1:]:
            cells[column] = str(float(cells[column]) * factor) if random.random() < 0.9 and _number(old) else new
    path.write_text("\n".join(map(delimiter.join, rows)) + "\n")
    return f"{kind} {named} of row {row + 1}: {rows[min(row, len(rows) - 1)][:8]}"


def _lines_changed(path: Path, random: Random) -> str:
    lines = path.read_text().splitlines(keepends=True)
    first = random.randrange(len(lines))
    after = min(len(lines), first + random.choice((1, 1, 20, len(lines))))
    kind = random.choice(("remove", "repeat", "move", "reverse", "shuffle", "cut", "keep"))
    part = lines[first:after]
    if kind == "remove":
        lines[first:after] = []
    elif kind == "repeat":
        lines[first:after] = part * 2
    elif kind == "move":
        lines[first:after] = []
        at = random.randrange(len(lines) + 1)
        lines[at:at] = part
    elif kind == "reverse":
        lines[first:after] = part[::-1]
    elif kind == "shuffle":
        random.shuffle(part)
        lines[first:after] = part
    elif kind == "cut":
        lines[first:] = [lines[first][: len(lines[first]) // 2]]
    else:
        lines[1:] = part
    path.write_text("".join(lines))
    return f"{kind} lines {first + 1} to {after}"


def _odd(value: str, random: Random) -> str:
    if _number(value) and random.random() < 0.4:
        return str(float(value) * random.choice((-1.0, 0.0, 0.1, 2.0, 1000.0)))
    return random.choice(CELLS)


def _number(value: str) -> bool:
    try:
        float(value)
    except ValueError:
        return False
    return True
