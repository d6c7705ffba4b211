"""Figures know their settings: a tiny plan is made, resumed, outdated by a changed default, and shown on a page."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import pytest

from isac_cosim.benchmarks.findings.figures.making import Maker
from isac_cosim.benchmarks.findings.figures.plan import FigureStage, Plan, read_plan
from isac_cosim.benchmarks.findings.figures.record import PRESENT, UNKNOWN, record_file
from isac_cosim.isacsim.scenarios import demand
from isac_cosim.studies.study import Study
from tests.benchmarks.findings.figures.tiny_plan import PAGE, PLAN, run, runs, state


def test_a_stage_makes_its_results_and_rewrites_the_table_of_its_page(root: Path) -> None:
    assert run(root) == 0
    assert (state(root, "data"), state(root)) == (PRESENT, PRESENT)
    page = (root / "docs/page.md").read_text()
    assert page == PAGE.replace("| 3 |", "| 12 |").replace("3 samples", "12 samples")


def test_the_folders_of_a_pattern_are_the_commands_own(root: Path) -> None:
    plan = root / "plan.toml"
    plan.write_text(PLAN.replace('["results/figures/data/set/count"]', '["results/figures/data/*/count"]'))
    assert run(root) == 1
    assert not (root / "results/figures/data/*").exists()
    plan.write_text(plan.read_text().replace('commands = ["echo run', 'commands = ["mkdir $FIGURES/data/set; echo run'))
    shutil.rmtree(root / "results")
    assert run(root) == 0


def test_sentences_are_claimed_by_hand(root: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """They quote figures, and no command rewrites them."""
    run(root)
    said = " ".join(capsys.readouterr().err.split())
    assert "docs/page.md: bring its sentences up to date, and claim it: <!-- figures: present scores -->" in said
    assert "earlier scores" in (root / "docs/page.md").read_text()


def test_present_stages_are_skipped_and_a_lost_result_is_made_again(root: Path) -> None:
    run(root)
    assert run(root) == 0
    assert runs(root) == 1
    (root / "docs/tiny/scores.json").unlink()
    assert state(root) == "not made: docs/tiny/scores.json is missing"
    assert run(root, "scores") == 0
    assert (runs(root), state(root)) == (1, PRESENT)


def test_a_present_stage_says_how_to_make_it_anew(root: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """In a fresh checkout, for a reader who follows the command above a table."""
    run(root)
    shutil.rmtree(root / "results")
    capsys.readouterr()
    assert run(root, "scores") == 0
    (record,) = re.findall(r"scores: present; delete (\S+) to make it anew", " ".join(capsys.readouterr().err.split()))
    assert not (root / "results/figures/scores").exists()
    (root / record).unlink()
    assert run(root, "scores") == 0
    assert (root / "results/figures/scores").exists()
    assert (runs(root), state(root)) == (1, PRESENT)


def test_what_lies_between_is_not_made_for_itself(root: Path) -> None:
    """In a fresh checkout, in which the documents have their results and nothing else is there."""
    run(root)
    shutil.rmtree(root / "results")
    assert run(root) == 0
    assert not (root / "results/figures/runs.txt").exists()
    assert run(root, "data") == 0
    assert runs(root) == 1


def test_what_a_stage_needs_is_made_first_where_it_is_missing(root: Path) -> None:
    assert run(root, "scores", "--jobs", "2") == 0
    assert runs(root) == 1


def test_a_failed_stage_keeps_what_is_finished_and_goes_on(root: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (root / "stop").touch()
    assert run(root) == 1
    assert "scores: failed: test ! -e stop: exit code 1" in capsys.readouterr().err
    assert state(root).startswith("not made")
    assert "earlier scores" in (root / "docs/page.md").read_text()
    (root / "stop").unlink()
    assert run(root) == 0
    assert runs(root) == 1


def test_a_stage_whose_need_failed_is_left_out(root: Path) -> None:
    plan = (root / "plan.toml").read_text()
    (root / "plan.toml").write_text(plan.replace("echo run >>", "false; exit 3 #"))
    became = Maker(root).make(read_plan(root / "plan.toml"), [])
    assert became["scores"] == "left out: data failed"
    assert not (root / "docs/tiny").exists()


def test_a_changed_default_outdates_the_stages_that_rest_on_it(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run(root)
    monkeypatch.setattr(demand, "HEADWAY_S", 9.5)
    assert state(root) == "made with other settings: traffic (isacsim.scenarios.demand.HEADWAY_S)"
    monkeypatch.undo()
    assert state(root) == PRESENT
    changed = Study.model_validate({"dataset": {"labels": {"preset": "mine-1", "hard_brake": {"threshold_mps2": 4.5}}}})
    monkeypatch.setattr(FigureStage, "settings", lambda stage, root: changed)
    assert state(root) == (
        "made with other settings: labels (dataset.labels.hard_brake.threshold_mps2, dataset.labels.preset)"
    )


def test_claims_that_do_not_hold_are_withdrawn(
    root: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    run(root)
    made = (root / "docs/page.md").read_text().replace("earlier", "present")
    (root / "docs/page.md").write_text(made)
    assert run(root, "withdraw") == 0
    assert (root / "docs/page.md").read_text() == made
    monkeypatch.setattr(demand, "HEADWAY_S", 9.5)
    capsys.readouterr()
    assert run(root, "withdraw") == 0
    assert capsys.readouterr().out == "docs/page.md: scores\n"
    assert (root / "docs/page.md").read_text() == made.replace("present", "earlier")


def test_only_the_parts_of_a_stage_count(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run(root)
    changed = Study.model_validate({"training": {"optimiser": {"epochs": 7}}})
    monkeypatch.setattr(FigureStage, "settings", lambda stage, root: changed)
    assert state(root) == PRESENT


def test_a_changed_file_that_a_stage_reads_outdates_it(root: Path) -> None:
    (root / "plan.toml").write_text(PLAN.replace("needs =", 'reads = ["*.xml"]\nneeds ='))
    (root / "roads.xml").write_text("<net/>")
    run(root)
    assert state(root) == PRESENT
    (root / "roads.xml").write_text("<net></net>")
    assert state(root) == "made with other settings: measurement (roads.xml)"


def test_changed_commands_outdate_a_stage(root: Path) -> None:
    run(root)
    (root / "plan.toml").write_text(PLAN.replace("echo 12", "echo 13"))
    assert state(root, "data") == "made with other settings: commands of the stage"


def test_a_stage_begun_with_other_settings_is_not_continued(
    root: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (root / "stop").touch()
    run(root)
    monkeypatch.setattr(demand, "HEADWAY_S", 9.5)
    (root / "stop").unlink()
    assert run(root) == 1
    said = " ".join(capsys.readouterr().err.split())
    assert "was begun with other settings: traffic (isacsim.scenarios.demand.HEADWAY_S); delete the folder" in said


def test_the_work_of_other_settings_is_not_taken_for_that_of_the_present_ones(
    root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Commands skip what they finished, and not all of them know each default that it rests on."""
    run(root)
    monkeypatch.setattr(demand, "HEADWAY_S", 9.5)
    assert run(root) == 1
    assert (runs(root), state(root, "data")[:24]) == (1, "made with other settings")
    for name in ("data", "scores"):
        shutil.rmtree(root / "results/figures" / name)
    assert run(root) == 0
    assert (runs(root), state(root)) == (2, PRESENT)


def test_figures_of_code_that_changed_meanwhile_are_not_recorded(
    root: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """This process has the settings of the code that it began with; commands take those of the code that is there."""
    (root / "isacsim").mkdir()
    (root / "isacsim" / "demand.py").write_text("HEADWAY_S = 1.5")
    change = "echo HEADWAY_S = 1.6 > isacsim/demand.py"
    (root / "plan.toml").write_text(PLAN.replace("echo 12 >", f"{change}; echo 12 >"))
    assert run(root) == 1
    assert "isacsim/demand.py was changed meanwhile; run again" in " ".join(capsys.readouterr().err.split())
    assert state(root, "data") == UNKNOWN
    assert run(root) == 0
    assert state(root) == PRESENT


def test_results_without_a_record_or_of_another_hand_are_not_present(root: Path) -> None:
    run(root)
    result = root / "docs/tiny/scores.json"
    result.write_text('{"samples": 99}')
    assert state(root) == "unknown: docs/tiny/scores.json is not the file that was recorded"
    record_file("scores", read_plan(root / "plan.toml").stage["scores"], root).unlink()
    assert state(root) == UNKNOWN


def test_the_record_has_a_digest_for_each_part_and_notices_a_change_of_its_own(root: Path) -> None:
    run(root)
    file = root / "docs/made_by/scores.json"
    content = json.loads(file.read_text())
    assert list(content["digests"]) == ["traffic", "labels"]
    assert content["versions"]["numpy"]
    content["digests"]["traffic"] = "0" * 64
    file.write_text(json.dumps(content))
    assert run(root, "status") == 2


def test_the_list_shows_costs_and_what_is_missing(root: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(root, "list") == 0
    said = capsys.readouterr().out
    assert "scores: how good are they?" in said
    assert "needs data; for docs/page.md" in said
    assert "to be made: 3 min on two cores" in said
    run(root)
    capsys.readouterr()
    assert run(root, "status") == 0
    assert capsys.readouterr().out == "scores: docs/tiny/scores.json in docs/page.md: present\n"


@pytest.mark.parametrize(
    ("before", "after", "said"),
    [
        ('needs = ["data"]', 'needs = ["date"]', "scores: needs date, which is no stage"),
        ('parts = ["traffic", "labels"]', 'parts = ["trafic"]', "trafic: no such part"),
        ('results = ["docs/tiny', 'results = ["../tiny', "lies outside of the checkout"),
    ],
)
def test_a_plan_at_fault_is_refused_in_one_line(
    root: Path, capsys: pytest.CaptureFixture[str], before: str, after: str, said: str
) -> None:
    (root / "plan.toml").write_text(PLAN.replace(before, after))
    assert run(root) == 2
    error = capsys.readouterr().err
    assert said in error
    assert len(error.splitlines()) == 1


def test_a_stage_asks_for_a_file_that_the_project_may_not_ship(root: Path, capsys: pytest.CaptureFixture[str]) -> None:
    plan = PLAN.replace(
        'needs = ["data"]', 'needs = ["data"]\ngiven = { "results/given/roads.xml" = "the roads of Flow" }'
    )
    (root / "plan.toml").write_text(plan)
    assert run(root, "list") == 0
    assert "needs data, results/given/roads.xml" in capsys.readouterr().out
    assert run(root) == 1
    said = " ".join(capsys.readouterr().err.split())
    assert "scores: failed: results/given/roads.xml: is not there; put there the roads of Flow" in said
    assert not (root / "results/figures/scores").exists()
    (root / "results/given").mkdir()
    (root / "results/given/roads.xml").write_text("<net/>")
    assert run(root) == 0
    (root / "results/given/roads.xml").unlink()
    assert state(root) == PRESENT


def test_an_unknown_stage_is_refused(root: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(root, "score") == 2
    assert "did you mean scores?" in capsys.readouterr().err


def test_a_page_that_names_a_table_that_is_not_printed_is_refused(root: Path) -> None:
    (root / "docs/page.md").write_text(PAGE.replace(": Scores -->", ": Marks -->"))
    became = Maker(root).make(read_plan(root / "plan.toml"), [])
    assert "scores: prints no table 'Marks'; correct the page" in became["scores"]


def test_stages_that_need_each_other_are_refused() -> None:
    stage = {"question": "?", "commands": ["true"], "results": ["a"], "cost_min": 1, "cost_is": "made up"}
    with pytest.raises(ValueError, match="stages need each other"):
        Plan.model_validate(
            {"stage": {"a": {**stage, "needs": ["b"]}, "b": {**stage, "results": ["b"], "needs": ["a"]}}}
        )
