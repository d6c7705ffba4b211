"""`evaluate --traffic`: what it is given, and what it shows."""

from __future__ import annotations

import io
import json
import re
from pathlib import Path

import pytest
from rich.console import Console

import cosim
from isac_cosim.base.errors import InputError
from isac_cosim.command_line import live
from isac_cosim.command_line.live import LiveArguments, evaluate_and_show, source_of
from isac_cosim.evaluation.closed_loop import evaluation as closed_loop_evaluation
from isac_cosim.evaluation.closed_loop.results import ArmResult, ClosedLoopFacts, ClosedLoopLatency, ClosedLoopResult
from isac_cosim.evaluation.closed_loop.safety import Totals, figures
from isac_cosim.evaluation.closed_loop.scoring import differences
from isac_cosim.evaluation.closed_loop.settings import ClosedLoopSettings
from isac_cosim.evaluation.in_traffic.measurement import evaluation
from isac_cosim.evaluation.in_traffic.settings import LiveStudy
from isac_cosim.evaluation.report import terminal
from isac_cosim.evaluation.report.loop_parts import Advisories
from isac_cosim.evaluation.report.parts import Shown
from isac_cosim.evaluation.report.registry import RESULT_PARTS
from isac_cosim.evaluation.report.replay import in_traffic
from isac_cosim.models.runs.run import Run
from isac_cosim.models.training.training import train_records
from tests.support.made_up import MADE_OF, SMALL_RUN, make_records
from tests.support.scripted import InlineEngine, ScriptedSource
from tests.support.sumo_recording import motorway_recording
from tests.support.trajectory_writers import states, write_fcd

NOTHING = LiveArguments()


def test_a_run_is_evaluated_on_a_dataset_or_in_traffic() -> None:
    assert source_of(Path("data"), None, NOTHING) == "data"
    assert source_of(None, "motorway", NOTHING) == "traffic"
    with pytest.raises(InputError, match="give one of them"):
        source_of(None, None, NOTHING)
    with pytest.raises(InputError, match="--duration applies to an evaluation in traffic"):
        source_of(Path("data"), None, LiveArguments(duration=30.0))
    for scene, option in ((True, "--scene"), (False, "--no-scene")):
        with pytest.raises(InputError, match=f"^{option} applies to an evaluation in traffic"):
            source_of(Path("data"), None, LiveArguments(scene=scene))


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    settings = SMALL_RUN.model_copy(update={"model": "trees"})
    return train_records(make_records(4, 2), MADE_OF, tmp_path_factory.mktemp("run") / "trees", settings)


@pytest.fixture
def scripted(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Traffic from formulas, of which one seed has none, in this process."""
    source = ScriptedSource(tmp_path, empty=(2002, 2003, 2004, 1002))
    for module in (evaluation, in_traffic):
        monkeypatch.setattr(module, "motion_source", lambda study: source)
    monkeypatch.setattr("isac_cosim.base.workers.engine.LocalEngine", lambda *_: InlineEngine())


@pytest.mark.usefixtures("scripted")
def test_the_command_measures_draws_and_prints(run: Run, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "live"
    seeds = ["--seeds", "1001:1002", "--development", "2001:2004"]
    words = ["evaluate", str(run.path), "--traffic", "road", *seeds, "-o", str(out), "--json"]
    assert cosim.main(words) == 0
    captured = capfd.readouterr()
    result = json.loads(captured.out.splitlines()[-1])
    assert {"vehicle_hours", "recall_at", "natural", "commanded", "baselines", "real_time_factor"} <= set(result)
    assert result["made_by"]["seeds"] == ["road-1001", "road-1002"]
    assert "vehicle-hours" in captured.err
    assert "rule of the road" in captured.err
    names = {path.name for path in out.iterdir()}
    assert {"metrics.json", "speed.json", "recall_against_false_alarms.png", "time_line.png", "index.html"} <= names
    moments = re.search(r'id="replay-data">(.*?)</script>', (out / "index.html").read_text(), re.DOTALL)
    assert moments is not None
    assert {one["id"].rpartition("-")[0] for one in json.loads(moments[1])["records"]} <= {
        "road-1001-follow0", "road-1001-follow1"
    }  # fmt: skip


@pytest.mark.slow
@pytest.mark.usefixtures("scripted")
def test_stress_adds_the_stimulated_world_on_the_same_seeds(
    run: Run, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "live"
    seeds = ["--seeds", "1001:1001", "--development", "2001:2001"]
    words = ["evaluate", str(run.path), "--traffic", "road", *seeds, "-o", str(out), "--json"]
    assert cosim.main(words) == 0
    assert "stress" not in json.loads(capfd.readouterr().out.splitlines()[-1])
    assert cosim.main([*words, "--stress"]) == 0
    captured = capfd.readouterr()
    result = json.loads(captured.out.splitlines()[-1])
    assert "twice the cost" in captured.err
    assert result["stress"]["vehicle_hours"] > 0
    stored = json.loads((out / "metrics.json").read_text())
    assert stored["stress"] == result["stress"]
    stressed = json.loads((out / "stress" / "metrics.json").read_text())
    assert stressed["made_by"]["seeds"] == stored["made_by"]["seeds"]
    worlds = [content["made_by"]["study"]["dataset"]["maneuvers"] for content in (stored, stressed)]
    assert worlds[0] != worlds[1]


def test_the_traffic_is_natural_unless_the_loop_is_closed(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    quiet: list[bool] = []
    scenes: list[bool] = []
    folders: list[str] = []

    def stop(loaded: Run, study: LiveStudy, *rest: object, **named: object) -> None:
        quiet.append(study.dataset.maneuvers.quiet)
        scenes.append(study.dataset.sensing.scene is not None)
        folders.extend(one.name for one in rest if isinstance(one, Path))
        raise InputError("stop")

    monkeypatch.setattr(evaluation, "evaluate_traffic", stop)
    monkeypatch.setattr(closed_loop_evaluation, "evaluate_advisories", stop)
    for arguments in ({}, {"natural": True}, {"advisories": True}, {"advisories": True, "natural": True}):
        with pytest.raises(InputError, match="stop"):
            live.evaluate_and_show(run.path, "motorway", LiveArguments(**arguments), None, (), Console())
    assert quiet == [True, True, False, True]
    assert not any(scenes)
    shown = Console(file=(printed := io.StringIO()), width=200)
    with pytest.raises(InputError, match="stop"):
        live.evaluate_and_show(run.path, "motorway", LiveArguments(scene=True), None, (), shown)
    assert scenes[-1]
    assert "about 10 min of processor time an episode" in printed.getvalue()
    assert (folders[0], folders[-1]) == ("traffic-motorway", "traffic-motorway-scene")
    with pytest.raises(InputError, match="leave out --stress"):
        source_of(None, "motorway", LiveArguments(advisories=True, stress=True))


def test_ranges_are_checked_before_anything_runs(run: Run, tmp_path: Path) -> None:
    console = Console(file=io.StringIO())
    for arguments, message in (
        (LiveArguments(seeds="5"), "--seeds 5: is not a range"),
        (LiveArguments(development="9:1"), "--development 9:1: is not a range"),
        (LiveArguments(seeds="1:9", development="5:6"), "overlap"),
        (LiveArguments(jobs=2, cluster="tcp://127.0.0.1:9"), "--jobs is for local .* give one of them"),
    ):
        with pytest.raises(InputError, match=message):
            evaluate_and_show(run.path, "motorway", arguments, tmp_path / "new", (), console)
    assert not (tmp_path / "new").exists()


def test_the_study_of_the_command_is_that_of_the_arguments(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    studies: list[LiveStudy] = []

    def stop(loaded: Run, study: LiveStudy, *rest: object, alone: Run | None) -> None:
        studies.append(study)
        raise InputError("stop")

    monkeypatch.setattr(evaluation, "evaluate_traffic", stop)
    with pytest.raises(InputError, match="stop"):
        live.evaluate_and_show(
            run.path,
            "motorway",
            LiveArguments(seeds="3:4", development="5:6", duration=20.0, jobs=1, truth=True),
            None,
            (),
            Console(),
        )
    (study,) = studies
    assert study.seeds == [5, 6, 3, 4]
    assert study.live.streams.truth
    assert study.dataset.traffic.duration_s == 20.0


@pytest.fixture
def drive(tmp_path: Path) -> Path:
    """FCD of the bundled motorway with two blocks: the second half of the minute is an hour later."""
    by_time = states(motorway_recording(), every=4)
    middle = list(by_time)[len(by_time) // 2]
    halves = {time if time < middle else round(time + 3600.0, 2): present for time, present in by_time.items()}
    return write_fcd(tmp_path / "drive.fcd.parquet", halves)


@pytest.mark.slow
def test_a_file_is_evaluated_in_the_open_loop(
    run: Run, drive: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("isac_cosim.base.workers.engine.LocalEngine", lambda *_: InlineEngine())
    out = tmp_path / "live"
    words = [
        "evaluate",
        str(run.path),
        "--traffic",
        str(drive),
        "--source",
        "fcd",
        "--network",
        "motorway",
        "-o",
        str(out),
    ]
    assert cosim.main([*words, "--development", "1:1", "--seeds", "2:2", "--json"]) == 0
    captured = capfd.readouterr()
    result = json.loads(captured.out.splitlines()[-1])
    assert result["made_by"]["seeds"] == ["drive-2"]
    assert result["made_by"]["study"]["dataset"]["source"] == "fcd"
    assert result["vehicle_hours"] > 0
    assert "in 2 block(s)" in captured.err
    for arguments, message in (
        (["--advisories"], "source fcd: has recordings only"),
        (["--stress"], "source fcd has no world"),
        (["--duration", "30"], "--duration: recordings of source fcd have their own length"),
        ([], "drive: has no seed of 2001:2100; it has 1 to 2; name others"),
        (["--seeds", "2:3", "--development", "1:1"], "drive: has no seed 3; give other"),
    ):
        assert cosim.main([*words, *arguments]) == 2
        assert message in capfd.readouterr().err.replace("\n", " ")
    with pytest.raises(InputError, match="--network: source sumo reads no road network"):
        evaluate_and_show(run.path, "motorway", LiveArguments(network="motorway"), None, (), Console())


def test_options_of_the_closed_loop_need_one() -> None:
    with pytest.raises(InputError, match="--conditioning applies to a closed loop: give --advisories"):
        source_of(None, "motorway", LiveArguments(conditioning="causal"))
    with pytest.raises(InputError, match="--advisories applies to an evaluation in traffic"):
        source_of(Path("data"), None, LiveArguments(advisories=True))
    with pytest.raises(InputError, match="--false-alarms applies to an evaluation in traffic"):
        source_of(Path("data"), None, LiveArguments(false_alarms=3.0))
    with pytest.raises(InputError, match="conditioning"):
        live.closed_loop_settings(LiveArguments(advisories=True, conditioning="later"))


def test_the_closed_loop_of_the_command_is_that_of_the_arguments(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[tuple[LiveStudy, ClosedLoopSettings, Path]] = []

    def stop(
        loaded: Run, study: LiveStudy, settings: ClosedLoopSettings, out: Path, *rest: object, alone: Run | None
    ) -> None:
        calls.append((study, settings, out))
        raise InputError("stop")

    monkeypatch.setattr(closed_loop_evaluation, "evaluate_advisories", stop)
    arguments = LiveArguments(
        seeds="3:4",
        development="5:6",
        duration=20.0,
        jobs=1,
        natural=True,
        advisories=True,
        conditioning="causal",
        false_alarms=9.0,
    )
    with pytest.raises(InputError, match="stop"):
        live.evaluate_and_show(run.path, "motorway", arguments, None, (), Console())
    ((study, settings, out),) = calls
    assert study.dataset.maneuvers.quiet
    assert settings.conditioning == "causal"
    assert study.live.choice.false_alarms_per_vehicle_hour == 9.0
    assert out == run.path / "traffic-motorway-advisories-natural"


def test_the_arms_are_shown_with_the_latency_and_the_intervals() -> None:
    none, advised = (Totals(1.0, 90.0, 100.0, danger, 10.0, 3, 1, 4.0, 6.0) for danger in (20.0, 15.0))

    def arm(totals: Totals, sent: int) -> ArmResult:
        change = differences([totals] * 3, [none] * 3)
        return ArmResult(
            what="", alarms=4, advisories=sent, fates={}, predicted_hours=1.0, collided=0, first_advisory_s={},
            after_alarms=dict(figures([totals])), all_traffic=dict(figures([totals])), difference=change,
            difference_all_traffic=change, collided_advised=0,
            difference_collided=change["ttc_below_1_5_s"],
        )  # fmt: skip

    facts = ClosedLoopFacts(
        settings=ClosedLoopSettings(),
        latency=ClosedLoopLatency(sensing_s=0.6, network_s=0.1, reaction_s=(0.6, 1.6)),
        scored_vehicle_hours=3.0,
        placebo_equals_none=True,
        seeds=3,
    )
    result = ClosedLoopResult.model_construct(
        arms={"none": arm(none, 0), "isac": arm(advised, 5)}, closed_loop=facts, name="trees", scenario="motorway"
    )
    console = Console(file=io.StringIO(), width=140)
    (first,) = RESULT_PARTS["live-first"].parts(Shown(result, Path()))
    assert "trees: 2 arms on the same 3 seeds" in first.text
    assert [figure for figure, _ in first.numbers] == ["-25.0 %", "+0.0 %", "-5.0"]
    parts = Advisories().parts(Shown(result, Path()))
    assert (
        parts[0]
        .seen["arms.png"]
        .endswith(
            "Time below 1.5 s of TTC: none +0 %; isac -25 %. Vehicles that collide in a seed: none +0.0; isac -5.0."
        )
    )
    terminal.show(parts, console)
    shown = console.file.getvalue()  # type: ignore[attr-defined]
    assert "3.00 vehicle-hours after alarms, 3 seeds" in shown
    assert "-25 %" in shown
    lines = parts[-1].lines
    assert lines[0].startswith("latency: sensing 0.6 s, network 0.1 s, driver 0.6 to 1.6 s")
    assert lines[1] == "ISAC against none: time below 1.5 s of TTC -25.0 %, -5.00 s per vehicle-hour"
