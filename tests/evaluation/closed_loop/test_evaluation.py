"""A closed loop from beginning to end in SUMO, in this process."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from isac_cosim.base.errors import InputError, RunError
from isac_cosim.base.workers.engine import LocalEngine
from isac_cosim.evaluation.closed_loop import episode
from isac_cosim.evaluation.closed_loop.evaluation import ClosedLoopEvaluation, evaluate_advisories
from isac_cosim.evaluation.closed_loop.results import ClosedLoopResult
from isac_cosim.evaluation.closed_loop.safety import FIGURES
from isac_cosim.evaluation.closed_loop.settings import ARMS, AdvisorySettings, ClosedLoopSettings
from isac_cosim.evaluation.in_traffic.settings import LiveStudy
from isac_cosim.evaluation.report.live.live_figures import arms as draw_arms
from isac_cosim.labeling.generation.settings import DatasetStudy
from isac_cosim.models.runs.run import Run
from tests.support.recorded_feedback import RecordedFeedback
from tests.support.scripted import InlineEngine

PROMPT = AdvisorySettings(network_delay_s=0.0, reaction_s=(0.0, 0.0))
SETTINGS = ClosedLoopSettings(arms=("none", "placebo", "truth"), advisories=PROMPT, after_s=4.0)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("closed_loop")


@pytest.fixture(scope="module")
def evaluation(trees_run: Run, study: LiveStudy, folder: Path) -> ClosedLoopEvaluation:
    return evaluate_advisories(trees_run, study, SETTINGS, folder, InlineEngine())


def test_the_result_says_what_the_contract_asks_for(evaluation: ClosedLoopEvaluation, folder: Path) -> None:
    stored = json.loads((folder / "metrics.json").read_text())
    assert ClosedLoopResult.model_validate(stored) == evaluation.result
    assert list(stored["arms"]) == ["none", "placebo", "truth"]
    for arm in stored["arms"].values():
        assert set(arm["after_alarms"]) == set(arm["difference"]) == set(FIGURES)
    assert stored["closed_loop"]["placebo_equals_none"] is True
    assert stored["closed_loop"]["latency"]["sensing_s"] == pytest.approx(0.6)
    assert {"recall_at", "coverage", "baselines"} <= set(stored)


def test_arms_without_advisories_do_not_differ(evaluation: ClosedLoopEvaluation) -> None:
    placebo = evaluation.result.arms["placebo"]
    assert {difference.value for difference in placebo.difference.values()} <= {0.0, None}
    assert placebo.alarms > 0
    isac = evaluation.result.arms["truth"]
    assert isac.advisories == sum(isac.fates.values()) > 0


def test_a_resumed_evaluation_repeats_nothing_and_gives_the_same_bytes(
    evaluation: ClosedLoopEvaluation,
    trees_run: Run,
    study: LiveStudy,
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    before = (folder / "metrics.json").read_bytes()
    lost = folder / "arms" / f"{evaluation.result.scenario}-2-truth.parquet"
    bytes_of_lost = lost.read_bytes()
    lost.unlink()
    run_arms: list[tuple[int, str]] = []
    run_arm = episode.run_arm

    def noted(*arguments: object) -> object:
        run_arms.append((arguments[3], arguments[4]))  # type: ignore[arg-type]
        if len(run_arms) == 1:
            raise RuntimeError("the first try fails")
        return run_arm(*arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(episode, "run_arm", noted)
    with pytest.raises(RunError, match="1 of 6 arms failed, seed 2, arm truth"):
        evaluate_advisories(trees_run, study, SETTINGS, folder, InlineEngine())
    evaluate_advisories(trees_run, study, SETTINGS, folder, InlineEngine())
    assert run_arms == [(2, "truth"), (2, "truth")]
    assert lost.read_bytes() == bytes_of_lost
    assert (folder / "metrics.json").read_bytes() == before


@pytest.mark.slow
def test_worker_processes_give_the_same_bytes(
    evaluation: ClosedLoopEvaluation, trees_run: Run, study: LiveStudy, folder: Path, tmp_path: Path
) -> None:
    evaluate_advisories(trees_run, study, SETTINGS, tmp_path, LocalEngine(2))
    names = ["metrics.json", "study.json", "arms.json"]
    names += [str(path.relative_to(folder)) for path in sorted(folder.glob("*/*.parquet"))]
    assert len(names) == 3 + len(study.seeds) + len(SETTINGS.arms) * len(study.dataset.seeds)
    for name in names:
        assert (tmp_path / name).read_bytes() == (folder / name).read_bytes(), name


def test_other_settings_of_the_loop_need_another_folder(
    evaluation: ClosedLoopEvaluation, trees_run: Run, study: LiveStudy, folder: Path
) -> None:
    other = SETTINGS.model_copy(update={"conditioning": "causal"})
    with pytest.raises(InputError, match="holds a closed loop with other settings"):
        evaluate_advisories(trees_run, study, other, folder, InlineEngine())


def test_more_seeds_and_other_alarms_continue_in_the_same_folder(
    evaluation: ClosedLoopEvaluation,
    trees_run: Run,
    study: LiveStudy,
    folder: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Only what rests on the change is driven again: not the traffic without advisories."""
    out = tmp_path / "copy"
    shutil.copytree(folder, out)
    run_arms: list[tuple[int, str]] = []
    run_arm = episode.run_arm

    def noted(*arguments: object) -> object:
        run_arms.append((arguments[3], arguments[4]))  # type: ignore[arg-type]
        return run_arm(*arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(episode, "run_arm", noted)
    fewer = study.model_copy(
        update={
            "dataset": study.dataset.model_copy(update={"seeds": study.dataset.seeds.model_copy(update={"last": 1})})
        }
    )
    evaluate_advisories(trees_run, fewer, SETTINGS, out, InlineEngine())
    evaluate_advisories(trees_run, study, SETTINGS, out, InlineEngine())
    assert {arm for _, arm in run_arms} <= {"random"}
    run_arms.clear()
    choice = study.live.choice.model_copy(update={"false_alarms_per_vehicle_hour": 100.0})
    other = study.model_copy(update={"live": study.live.model_copy(update={"choice": choice})})
    result = evaluate_advisories(trees_run, other, SETTINGS, out, InlineEngine()).result
    assert result.made_by.study.live.choice.false_alarms_per_vehicle_hour == 100.0
    assert "none" not in {arm for _, arm in run_arms}


def test_a_refused_closed_loop_leaves_the_result_as_it_was(
    evaluation: ClosedLoopEvaluation, trees_run: Run, study: LiveStudy, folder: Path
) -> None:
    before = {name: (folder / name).read_bytes() for name in ("metrics.json", "study.json", "arms.json")}
    choice = study.live.choice.model_copy(update={"false_alarms_per_vehicle_hour": 100.0})
    other = study.model_copy(update={"live": study.live.model_copy(update={"choice": choice})})
    causal = SETTINGS.model_copy(update={"conditioning": "causal"})
    with pytest.raises(InputError, match="holds a closed loop with other settings"):
        evaluate_advisories(trees_run, other, causal, folder, InlineEngine())
    assert before == {name: (folder / name).read_bytes() for name in before}


def test_the_arms_are_drawn(evaluation: ClosedLoopEvaluation, tmp_path: Path) -> None:
    draw_arms(evaluation.result, tmp_path / "arms.png")
    assert (tmp_path / "arms.png").stat().st_size > 10_000


def test_no_connected_vehicle_is_said(trees_run: Run, study: LiveStudy, tmp_path: Path) -> None:
    pairs = study.dataset.pairs.model_copy(update={"connected_share": 0.0})
    seeds = study.dataset.seeds.model_copy(update={"last": 1})
    development = study.development.model_copy(update={"last": 11})
    dataset = study.dataset.model_copy(update={"pairs": pairs, "seeds": seeds})
    alone = study.model_copy(update={"dataset": dataset, "development": development})
    feedback, settings = RecordedFeedback(), SETTINGS.model_copy(update={"arms": ("none",)})
    result = evaluate_advisories(trees_run, alone, settings, tmp_path, InlineEngine(), feedback).result
    assert list(result.arms) == ["none", "placebo"]
    assert result.arms["none"].after_alarms["ttc_below_3_s"] is None
    assert result.arms["none"].all_traffic["mean_speed_mps"] > 20.0
    assert any("the placebo arm raised no alarm" in line for line in feedback.messages)


def test_recorded_traffic_has_no_closed_loop(trees_run: Run, study: LiveStudy, tmp_path: Path) -> None:
    dataset = DatasetStudy(source="kinematic")
    recorded = study.model_copy(update={"dataset": dataset})
    with pytest.raises(InputError, match="kinematic: has recordings only, and a closed loop needs a world that runs"):
        evaluate_advisories(trees_run, recorded, SETTINGS, tmp_path)


def test_every_arm_is_described() -> None:
    assert ClosedLoopSettings().arms == tuple(ARMS)
