"""Makes the figures of the documents, or says which of them are of the present settings.

    python -m isac_cosim.benchmarks.findings.figures [STAGE ...] [--jobs N] [--cluster ADDRESS]
    python -m isac_cosim.benchmarks.findings.figures list      the stages, what they cost, and whether they are present
    python -m isac_cosim.benchmarks.findings.figures status    the stored results, each "present" or what differs
    python -m isac_cosim.benchmarks.findings.figures withdraw  pages no longer claim as present what is not
    python -m isac_cosim.benchmarks.findings.figures keep      what is finished of unfinished stages is kept

`make figures STAGE=...` and `make figures-status` call it. A stage whose results are present is skipped; an interrupted
one goes on where its commands can.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from rich.console import Console

from isac_cosim.base.errors import InputError, RunError
from isac_cosim.base.feedback import spoken_time
from isac_cosim.base.progress import ConsoleFeedback
from isac_cosim.benchmarks.findings.figures import unfinished
from isac_cosim.benchmarks.findings.figures.making import Maker
from isac_cosim.benchmarks.findings.figures.pages import claims, withdrawn, write_page
from isac_cosim.benchmarks.findings.figures.plan import ROOT, Plan, read_plan
from isac_cosim.benchmarks.findings.figures.record import PRESENT, status


def listed(plan: Plan, root: Path) -> str:
    """Return the stages with their costs, needs and pages, and the cost of all that is not present."""
    lines, missing_min = [], 0.0
    for name, stage in plan.stage.items():
        state = status(name, stage, root)
        missing_min += stage.cost_min if state != PRESENT else 0.0
        lines += [
            f"{name}: {stage.question}",
            f"    {spoken_time(60.0 * stage.cost_min)} on two cores ({stage.cost_is})"
            + (f"; needs {', '.join([*stage.needs, *stage.given])}" if stage.needs or stage.given else "")
            + (f"; for {', '.join(stage.pages)}" if stage.pages else ""),
            f"    {state}",
        ]
    return "\n".join([*lines, f"to be made: {spoken_time(60.0 * missing_min)} on two cores"])


def statuses(plan: Plan, root: Path) -> str:
    """Return a line for each stored result: its stage, its pages, and whether it is present or why not."""
    lines = []
    for name, stage in plan.stage.items():
        state = status(name, stage, root)
        shown = f" in {', '.join(stage.pages)}" if stage.pages else ""
        lines += [f"{name}: {path}{shown}: {state}" for path in stage.results if path.startswith("docs/")]
    return "\n".join(lines)


def withdraw(plan: Plan, root: Path) -> str:
    """Withdraw the claims of pages that do not hold; return a line for each."""
    lines = []
    outdated = {name for name, stage in plan.stage.items() if status(name, stage, root) != PRESENT}
    for page in sorted({page for stage in plan.stage.values() for page in stage.pages}):
        text = (root / page).read_text(encoding="utf-8")
        lines += [f"{page}: {name}" for name, present in claims(text).items() if present and name in outdated]
        write_page(root / page, text, withdrawn(text, outdated))
    return "\n".join(lines) or "every claim holds"


def keep(plan: Plan, root: Path) -> str:
    """Keep what is finished of unfinished stages, and show it on their pages; return a line for each."""
    lines = []
    for name, stage in plan.stage.items():
        if became := unfinished.keep(name, stage, root):
            lines.append(f"{name}: {became}")
            Maker(root).rewrite_pages(name, stage)
    return "\n".join(lines) or "nothing is finished of an unfinished stage"


SHOWN = {"list": listed, "status": statuses, "withdraw": withdraw, "keep": keep}
"""What is said instead of making anything, by the word that takes the place of stages."""


def main(arguments: list[str], plan_file: Path | None = None, root: Path = ROOT) -> int:
    """Do what the command line says; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("stages", nargs="*", metavar="STAGE")
    parser.add_argument("--jobs", type=int, default=1, help="stages that run side by side")
    parser.add_argument("--cluster", help="address of a scheduler on which the commands run that can")
    given = parser.parse_args(arguments)
    if given.jobs < 1:
        parser.error("--jobs: give 1 or more")
    try:
        plan = read_plan() if plan_file is None else read_plan(plan_file)
        if len(given.stages) == 1 and given.stages[0] in SHOWN:
            print(SHOWN[given.stages[0]](plan, root))
            return 0
        became = Maker(root, given.jobs, given.cluster, ConsoleFeedback(Console(stderr=True))).make(plan, given.stages)
    except (InputError, RunError) as error:
        print(error, file=sys.stderr)
        return 2 if isinstance(error, InputError) else 1
    except KeyboardInterrupt:
        print("interrupted; the same command goes on", file=sys.stderr)
        return 130
    return int(any(state not in (PRESENT, "made") for state in became.values()))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
