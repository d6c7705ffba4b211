"""`evaluate --traffic`: from its arguments to a result on the console."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from rich.console import Console

from isac_cosim.base.errors import InputError
from isac_cosim.base.parsing import number_range
from isac_cosim.base.progress import print_line
from isac_cosim.command_line import options, output
from isac_cosim.command_line.arguments import of_network
from isac_cosim.isacsim.scenarios.scenario import resolved
from isac_cosim.isacsim.traffic.sources.registry import natural_world, recognised, source_class

if TYPE_CHECKING:
    from isac_cosim.evaluation.closed_loop.evaluation import ClosedLoopEvaluation
    from isac_cosim.evaluation.closed_loop.settings import ClosedLoopSettings
    from isac_cosim.evaluation.in_traffic.settings import LiveSettings


@dataclass(frozen=True, kw_only=True)
class LiveArguments:
    """The arguments of `evaluate` that apply to running traffic; None where not given."""

    seeds: str | None = None
    development: str | None = None
    duration: float | None = None
    jobs: int | None = None
    natural: bool | None = None
    stress: bool | None = None
    advisories: bool | None = None
    conditioning: str | None = None
    false_alarms: float | None = None
    truth: bool | None = None
    alone: Path | None = None
    cluster: str | None = None
    lanes: bool | None = None
    source: str | None = None
    network: str | None = None
    scene: bool | None = None


def source_of(data: Path | None, traffic: str | None, live: LiveArguments) -> Literal["data", "traffic"]:
    """Return what a run is evaluated on. Raises InputError unless it is exactly one of both."""
    if (data is None) == (traffic is None):
        raise InputError("evaluate on a dataset (--data DATASET) or in traffic (--traffic SCENARIO): give one of them")
    if traffic is not None:
        if live.conditioning is not None and not live.advisories:
            raise InputError("--conditioning applies to a closed loop: give --advisories")
        if live.stress and live.advisories:
            raise InputError("--advisories runs in one world, by default the stimulated one: leave out --stress")
        return "traffic"
    for name, value in asdict(live).items():
        if value is not None and (value is not False or name in ("lanes", "scene")):
            option = f"no-{name}" if value is False else name.replace("_", "-")
            raise InputError(f"--{option} applies to an evaluation in traffic: give --traffic SCENARIO")
    return "data"


def evaluate_and_show(
    run: Path, scenario: str, arguments: LiveArguments, out: Path | None, against: Sequence[Path], console: Console
) -> dict[str, Any]:
    """Evaluate a run in running traffic, draw its figures and show its scores. Returns what `--json` prints."""
    from isac_cosim.evaluation.in_traffic.measurement.evaluation import evaluate_traffic, study_of
    from isac_cosim.evaluation.in_traffic.measurement.stress import STRESS, with_stress
    from isac_cosim.evaluation.report.live.live_figures import draw_live_figures
    from isac_cosim.evaluation.report.replay.advised import with_instructions
    from isac_cosim.evaluation.report.replay.in_traffic import replay_in_traffic
    from isac_cosim.evaluation.report.report import show_live
    from isac_cosim.labeling.streams.cost_estimate import estimate
    from isac_cosim.models.runs.run import load_run

    loaded = load_run(run)
    seeds, development = (
        None if text is None else number_range(text, f"--{name}", int, "1001:1004")
        for name, text in (("seeds", arguments.seeds), ("development", arguments.development))
    )
    settings, source = live_settings(arguments), arguments.source or recognised([scenario])
    # Recordings are as they are: their source has no world in which drivers are left alone, and none to stress.
    worlds = source_class(source).natural is not None
    if arguments.natural or arguments.stress:
        natural_world(source, "--natural" if arguments.natural else "--stress")
    sections = {} if arguments.network is None else {of_network(source): {"network": resolved(arguments.network)}}
    chosen = (loaded.card, scenario, seeds, development, arguments.duration, settings)
    natural = worlds and (bool(arguments.natural) or not arguments.advisories)
    study = study_of(*chosen, natural=natural, source=source, sections=sections, scene=arguments.scene)
    stressed = study_of(*chosen, source=source, scene=arguments.scene) if arguments.stress else None
    kind = f"-advisories{'-natural' if natural else ''}" if arguments.advisories else ""
    if arguments.scene is not None:
        kind += "-scene" if arguments.scene else "-no-scene"
    folder = out or run / f"traffic-{Path(scenario).name}{kind}"
    engine, feedback = options.engine_of(arguments.jobs, arguments.cluster, folder), output.feedback_of(console)
    others = [load_run(path) for path in against]
    alone = None if arguments.alone is None else load_run(arguments.alone)
    closed_loop: ClosedLoopEvaluation | None = None
    cost = None if study.dataset.sensing.scene is None else estimate(study.dataset)
    if cost is not None:
        minutes = cost.cpu_s / cost.episodes / 60
        print_line(
            console, f"a scene is sensed: about {minutes:.0f} min of processor time an episode, as on the motorway"
        )
    if arguments.advisories:
        from isac_cosim.evaluation.closed_loop.evaluation import evaluate_advisories
        from isac_cosim.evaluation.report.live.live_figures import arms

        loop_settings = closed_loop_settings(arguments)
        closed_loop = evaluate_advisories(loaded, study, loop_settings, folder, engine, feedback, others, alone=alone)
        evaluation = closed_loop.open_loop
        arms(closed_loop.result, folder / "arms.png")
    else:
        if stressed is not None:
            print_line(console, f"the stimulated world is run on the same seeds, in {folder / STRESS}: twice the cost")
        evaluation = evaluate_traffic(loaded, study, folder, engine, feedback, others, alone=alone)
        if stressed is not None:
            evaluation = with_stress(evaluation, loaded, stressed, folder, engine, feedback, others)
    draw_live_figures(evaluation, folder)
    output.note_former([loaded, *others, *([] if alone is None else [alone])], console)
    result = evaluation.result if closed_loop is None else closed_loop.result
    replay = replay_in_traffic(evaluation, engine, feedback, folder=folder)
    if closed_loop is not None:
        replay = with_instructions(replay, closed_loop, engine, feedback, folder)
    show_live(result, folder, console, replay)
    print_line(console, f"page, figures and metrics.json: {folder}")
    return {"report": str(folder), **result.model_dump(mode="json"), "real_time_factor": evaluation.real_time_factor}


def live_settings(arguments: LiveArguments) -> LiveSettings:
    """Return the settings of watching, alarms and scores. Raises InputError where an argument is wrong."""
    from isac_cosim.base.settings import checked
    from isac_cosim.evaluation.in_traffic.settings import LiveSettings

    rate = arguments.false_alarms
    choice = {} if rate is None else {"false_alarms_per_vehicle_hour": rate}
    content = {
        "choice": choice,
        "streams": {"truth": bool(arguments.truth)},
        "background": {} if arguments.lanes is None else {"lanes": arguments.lanes},
    }
    return checked(LiveSettings, content, "arguments")


def closed_loop_settings(arguments: LiveArguments) -> ClosedLoopSettings:
    """Return the settings of a closed loop. Raises InputError where an argument is wrong."""
    from isac_cosim.base.settings import checked
    from isac_cosim.evaluation.closed_loop.settings import ClosedLoopSettings

    given = {} if arguments.conditioning is None else {"conditioning": arguments.conditioning}
    return checked(ClosedLoopSettings, given, "arguments")
