"""Verdicts on the modules of CaSTFormer: three trainings a fold decide, a single one does not."""

from __future__ import annotations

from isac_cosim.studies.reproduction.castformer.claims import castformer_claims
from isac_cosim.studies.reproduction.castformer.measured import MeasuredVariant, with_repeats
from isac_cosim.studies.reproduction.castformer.variants import ablation, main_comparison
from isac_cosim.studies.reproduction.experiments.trainings import Scores
from isac_cosim.studies.reproduction.experiments.verdicts import Verdict


def folds(right: int, shift: int = 0) -> list[Scores]:
    """Scores of five folds with `right` of 100 windows of either class right, give or take one."""
    hits = [right + (k + shift) % 2 for k in range(5)]
    counts = [[[hit, 100 - hit], [100 - hit, hit]] for hit in hits]
    return [Scores(name="", training_seed=0, counts={"0": {"road-1": c}}, windows={}) for c in counts]


def verdicts(networks: list[MeasuredVariant]) -> dict[str, Verdict]:
    claims = castformer_claims({"ablation": {row.name: {0: row.at(0)} for row in networks}})
    return {c.claim: c.verdict for c in claims}


def test_one_training_a_fold_leaves_the_modules_undecided() -> None:
    right = {row.name: 95 if row.name == "complete" else 80 for row in ablation()}
    once = [MeasuredVariant(row.name, row.title, folds(right[row.name])) for row in ablation()]
    together = "The three modules together improve the baseline at 0 s"
    assert verdicts(once)[together] == "undecided"
    repeats = [
        [MeasuredVariant(row.name, row.title, folds(right[row.name], shift)) for row in main_comparison()]
        for shift in (1, 2)
    ]
    thrice = with_repeats(once, repeats)
    assert verdicts(thrice)[together] == "holds"
    assert verdicts(thrice)["RSF alone improves the baseline at 0 s"] == "undecided"
    by_name = {row.name: row for row in thrice}
    assert len(by_name["complete"].at(0)) == 3
    assert len(by_name["modules-rsf+cpe"].at(0)) == 1


def test_the_main_comparison_is_the_baseline_each_module_and_all() -> None:
    assert [row.name for row in main_comparison()] == [
        "modules-none", "modules-rsf", "modules-cpe", "modules-fsn", "complete",
    ]  # fmt: skip
