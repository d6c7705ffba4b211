"""The table of docs/kinematic.md: how well the true motion tells the intentions apart, by predictor and world.

    python docs/kinematic_table.py RESULT.json ...

Each file holds what `isac_cosim.benchmarks.findings.kinematic_calibration` printed. Prints the table in Markdown;
brackets hold 95 % intervals over test seeds.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from isac_cosim.evaluation.report.parts import markdown, text_of
from isac_cosim.evaluation.statistics import Estimate
from isac_cosim.labeling.intentions import KNOWN, spoken
from isac_cosim.models.predictors.registry import PREDICTORS
from isac_cosim.studies.reproduction.experiments.paper_figures import CASES, CLASS_F1

TRUE_MOTION = 1
"""The paper's number of the case."""


def table(results: Sequence[dict[str, Any]]) -> str:
    """Return the table of results, a column for each, beside what the paper has of ASI-BIP."""
    heads = [f"{PREDICTORS[r['model']].display_name}, {r['world']}, share {r['share']:g}" for r in results]
    rows = [
        [name, *(text_of(Estimate(**result[key])) for result in results), text_of(paper)]
        for name, key, paper in zip(("accuracy", "macro-F1"), ("accuracy", "macro_f1"), CASES[TRUE_MOTION], strict=True)
    ]
    for kind in KNOWN:
        scores = [f"{result['f1'][kind.text]:.3f}" for result in results]
        rows.append([f"F1, {spoken(kind.text)}", *scores, text_of(CLASS_F1.get(kind.text))])
    return markdown(["", *heads, "the paper"], rows)


def main() -> None:
    """Print the table of the files that are named."""
    results = [json.loads(Path(name).read_text(encoding="utf-8")) for name in sys.argv[1:]]
    counted = sorted({(result["training_records"], result["windows"]) for result in results})
    sizes = "; ".join(f"{records:,} training records, {windows:,} test windows" for records, windows in counted)
    print(f"### True motion: {sizes}\n")
    print(table(results))


if __name__ == "__main__":
    main()
