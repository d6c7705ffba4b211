"""The table of a sweep for the documents, from what `cosim run` of a study with a `[sweep]` wrote.

    python docs/sweep_tables.py TABLE.json

Prints it in Markdown: a row a cell, with means over training seeds, ± their standard deviation, and the difference to
the trees on the same windows with its 95 % interval over the test seeds.
"""

from __future__ import annotations

import sys
from pathlib import Path

from isac_cosim.evaluation.report.parts import markdown, text_of
from isac_cosim.studies.sweep_results import SweepResult
from isac_cosim.studies.sweep_table import parts


def main() -> None:
    """Print the table of the sweep that the command line names."""
    result = SweepResult.model_validate_json(Path(sys.argv[1]).read_bytes())
    brief = parts(result)[0].rows
    print(f"### The cells of {result.study}\n")
    print(markdown(list(brief[0]), [[text_of(cell) for cell in row.values()] for row in brief]))


if __name__ == "__main__":
    main()
