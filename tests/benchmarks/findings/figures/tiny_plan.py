"""A tiny plan of two stages with a page, in a folder that takes the place of the checkout."""

from __future__ import annotations

from pathlib import Path

from isac_cosim.benchmarks.findings.figures.__main__ import main
from isac_cosim.benchmarks.findings.figures.plan import read_plan
from isac_cosim.benchmarks.findings.figures.record import status

PLAN = """
[stage.data]
question = "how many samples are there?"
commands = ["echo run >> $FIGURES/runs.txt", "echo 12 > $FIGURES/data/set/count"]
results = ["results/figures/data/set/count"]
cost_min = 1
cost_is = "made up"
parts = ["traffic", "labels"]

[stage.scores]
question = "how good are they?"
commands = [
    "test ! -e stop",
    "echo '{\\"samples\\": '$(cat $FIGURES/data/set/count)'}' > docs/tiny/scores.json",
]
results = ["docs/tiny/scores.json"]
tables = ["python docs/scores.py"]
pages = ["docs/page.md"]
cost_min = 2
cost_is = "made up"
needs = ["data"]
parts = ["traffic", "labels"]
"""
SCORES = """
import json
n = json.load(open("docs/tiny/scores.json"))["samples"]
print(f"### Scores: {n} samples\\n\\n| n |\\n| --- |\\n| {n} |")
"""
PAGE = """# A page

<!-- figures: earlier scores -->

<!-- table scores: Scores -->
### Scores: 3 samples

`make figures STAGE=scores`

| n |
| --- |
| 3 |

What follows stays | as it is |.
"""


def run(root: Path, *arguments: str) -> int:
    return main(list(arguments), root / "plan.toml", root)


def state(root: Path, name: str = "scores") -> str:
    return status(name, read_plan(root / "plan.toml").stage[name], root)


def runs(root: Path) -> int:
    return len((root / "results/figures/runs.txt").read_text().split())
