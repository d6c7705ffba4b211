"""The tables of docs/reproduction.md, from the files that the stages of `cosim reproduce` left.

    python docs/reproduction_tables.py docs/reproduction/asi-bip

Prints them in Markdown, those of stages that were run. ± is the standard deviation over the trainings; brackets hold
95 % intervals.
"""

from __future__ import annotations

import shutil
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from isac_cosim.base.settings import read_json
from isac_cosim.evaluation.report.parts import markdown, text_of
from isac_cosim.studies.reproduction.asi_bip import stages as asi_bip
from isac_cosim.studies.reproduction.asi_bip.report import asi_bip_parts
from isac_cosim.studies.reproduction.castformer.report import castformer_parts
from isac_cosim.studies.reproduction.experiments.sizes import AsiBipSize
from isac_cosim.studies.reproduction.experiments.stages import MARK, STAGES, Identity


def tables(folder: Path) -> Iterator[str]:
    """Yield each table of a reproduction with its heading. folder: holds `reproduction.json` and `stages`."""
    identity = read_json(Identity, folder / MARK)
    if identity is None:
        raise SystemExit(f"{folder}: holds no reproduction")
    with tempfile.TemporaryDirectory() as scratch:
        # The parts of the page come with figures, which are drawn beside the stages.
        out = Path(scratch) / "out"
        shutil.copytree(folder / STAGES, out / STAGES)
        if identity.paper == asi_bip.PAPER:
            parts, _ = asi_bip_parts(out, AsiBipSize.model_validate(identity.settings))
        else:
            parts, _ = castformer_parts(out)
    for part in parts:
        if part.rows:
            rows = [[text_of(row.get(name)) for name in part.headings] for row in part.rows]
            yield f"### {part.title}\n\n{markdown(part.headings, rows)}\n"


def main() -> None:
    """Print the tables of the folder that the command line names."""
    for table in tables(Path(sys.argv[1])):
        print(table)


if __name__ == "__main__":
    main()
