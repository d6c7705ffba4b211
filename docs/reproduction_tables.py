"""The tables of docs/reproduction.md, from the files that the stages of `cosim reproduce` left.

    python docs/reproduction_tables.py docs/reproduction/asi-bip [docs/unfinished/asi-bip/out]

Prints them in Markdown, those of stages that were run. ± is the standard deviation over the trainings; brackets hold
95 % intervals. The second folder, where there is one, holds what is finished of a run with the present settings: its
tables follow, without rows of what was not run, and take the place of those of the first that say no more.
"""

from __future__ import annotations

import shutil
import sys
import tempfile
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path

from isac_cosim.base.settings import read_json
from isac_cosim.evaluation.report.parts import Part, Row, markdown, text_of
from isac_cosim.evaluation.statistics import Estimate
from isac_cosim.studies.reproduction.asi_bip import stages as asi_bip
from isac_cosim.studies.reproduction.asi_bip.report import asi_bip_parts
from isac_cosim.studies.reproduction.castformer.report import castformer_parts
from isac_cosim.studies.reproduction.experiments.pages import CLAIMS
from isac_cosim.studies.reproduction.experiments.sizes import AsiBipSize
from isac_cosim.studies.reproduction.experiments.stages import MARK, STAGES, Identity


def tables(folder: Path, without: Collection[str] = ()) -> Iterator[str]:
    """Yield each table of a reproduction with its heading.

    folder: holds `reproduction.json` and `stages`. without: names of parts that are left out.
    """
    for part in _parts(folder):
        if part.name not in without:
            yield _table(part.title, part, part.rows)


def tables_in_part(folder: Path) -> Iterator[str]:
    """Yield the tables of an unfinished reproduction in which something is measured, without claims on what is not."""
    for part in _parts(folder):
        if measured := _measured(part):
            name, colon, subject = part.title.partition(":")
            yield _table(
                f"{name} in the present preset{colon}{subject}", part, measured if part.name == CLAIMS else part.rows
            )


def repeated(whole: Path, unfinished: Path) -> set[str]:
    """Return the names of the parts of a whole reproduction that an unfinished one has measured all of."""

    def subjects(part: Part) -> set[str]:
        return {str(row[part.headings[0]]) for row in _measured(part)}

    anew = {part.name: subjects(part) for part in _parts(unfinished)}
    return {part.name for part in _parts(whole) if anew.get(part.name) and subjects(part) <= anew[part.name]}


def _measured(part: Part) -> list[Row]:
    return [row for row in part.rows if any(isinstance(value, Estimate) for value in row.values())]


def _table(title: str, part: Part, rows: Sequence[Row]) -> str:
    cells = [[text_of(row.get(name)) for name in part.headings] for row in rows]
    return f"### {title}\n\n{markdown(part.headings, cells)}\n"


def _parts(folder: Path) -> list[Part]:
    identity = read_json(Identity, folder / MARK)
    if identity is None:
        raise SystemExit(f"{folder}: holds no reproduction")
    with tempfile.TemporaryDirectory() as scratch:
        # The parts of the page come with figures, which are drawn beside the stages.
        out = Path(scratch) / "out"
        shutil.copytree(folder / STAGES, out / STAGES)
        shutil.copyfile(folder / MARK, out / MARK)
        if identity.paper == asi_bip.PAPER:
            parts, _ = asi_bip_parts(out, AsiBipSize.model_validate(identity.settings))
        else:
            parts, _ = castformer_parts(out)
    return [part for part in parts if part.rows]


def main() -> None:
    """Print the tables of the folders that the command line names."""
    whole, *unfinished = (Path(folder) for folder in sys.argv[1:])
    begun = [folder for folder in unfinished if folder.exists()]
    without = {name for folder in begun for name in repeated(whole, folder)}
    for table in (*tables(whole, without), *(table for folder in begun for table in tables_in_part(folder))):
        print(table)


if __name__ == "__main__":
    main()
