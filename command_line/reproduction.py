"""`reproduce`: from its arguments to a page and the verdicts on the console."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rich.console import Console

from isac_cosim.base.progress import print_line
from isac_cosim.command_line import output
from isac_cosim.command_line.options import cores, engine_of
from isac_cosim.evaluation.report import terminal
from isac_cosim.evaluation.report.parts import Part, Row

if TYPE_CHECKING:
    from isac_cosim.base.workers.engine import Engine
    from isac_cosim.studies.reproduction.reproduce import Request


def engine_for(wanted: Request, jobs: int | None, cluster: str | None) -> Engine:
    """Return what runs a reproduction: as told, or else the local worker processes with which it is shortest."""
    from isac_cosim.studies.reproduction.reproduce import best_workers

    if jobs is None and cluster is None:
        jobs = best_workers(wanted, cores())
    return engine_of(jobs, cluster, wanted.out)


def show_cost(wanted: Request, engine: Engine, console: Console) -> dict[str, Any]:
    """Show what a reproduction still costs, stage by stage. Returns what `--json` prints."""
    from isac_cosim.base.feedback import spoken_time
    from isac_cosim.studies.reproduction.experiments.stages import cost_in_words
    from isac_cosim.studies.reproduction.reproduce import expected_cost

    cost = expected_cost(wanted, engine)
    print_line(console, cost_in_words(cost))
    for stage, seconds in cost.stages.items():
        print_line(console, f"  {stage}: {spoken_time(seconds)}")
    return cost.model_dump(mode="json")


def reproduce_and_show(wanted: Request, engine: Engine, console: Console) -> dict[str, Any]:
    """Run a reproduction and show its verdicts. Returns what `--json` prints."""
    from isac_cosim.studies.reproduction.reproduce import reproduce

    result = reproduce(wanted, engine, output.feedback_of(console))
    checklist: list[Row] = [
        {"claim": claim.claim, "verdict": claim.verdict, "ours": claim.measured, "paper": claim.paper}
        for claim in result.claims
    ]
    terminal.show([Part("claims", "What the paper claims", rows=checklist)], console)
    if wanted.size != "full":
        print_line(console, f"size {wanted.size}: these figures say nothing about the paper")
    if result.not_run:
        print_line(console, f"not run: {', '.join(result.not_run)}")
    print_line(console, f"page: {result.page}")
    return result.model_dump(mode="json")
