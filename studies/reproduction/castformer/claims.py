"""What the CaSTFormer paper claims, checked against the scores of the stages."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise

from isac_cosim.evaluation.on_windows.maneuvers import maneuver_statistic
from isac_cosim.evaluation.statistics import Statistic, Trainings, difference, estimate
from isac_cosim.studies.reproduction.castformer.variants import COMPLETE, MODULES
from isac_cosim.studies.reproduction.experiments.paper_figures import (
    ABLATION,
    BEST_ALPHA,
    HORIZON,
    HORIZONS_S,
    ORDERS,
    end_of,
)
from isac_cosim.studies.reproduction.experiments.verdicts import Claim, corrected, is_above, judged

BASELINE = "modules-none"
Networks = Mapping[str, Mapping[int, Trainings]]
"""Confusion matrices by network and horizon, s."""
ABOVE_0 = is_above("the difference in F1 is above 0")


def castformer_claims(stages: Mapping[str, Networks], background: int | None = None) -> list[Claim]:
    """Return every claim with its verdict.

    stages: the networks of each stage that was run. background: the class that is no maneuver, if there is one.
    """
    f1 = maneuver_statistic("f1", background)
    horizon, modules = stages.get("horizon", {}), stages.get("ablation", {})
    return corrected([*_horizon(horizon, f1), *_modules(modules, f1), *_others(stages, f1)])


def _horizon(networks: Networks, f1: Statistic) -> list[Claim]:
    claims = []
    row = HORIZON["CaSTFormer"]
    for k, (near, far) in enumerate(pairwise(HORIZONS_S)):
        measured = None
        if COMPLETE.name in networks:
            at = networks[COMPLETE.name]
            measured = estimate(difference(f1), at[near], at[far])
        words = f"F1 declines from {end_of(near)} to {end_of(far)}"
        # Of one network at two horizons: every fold has a training of its own, and no two networks are compared.
        claims.append(judged("horizon", words, f"{row[k]} % to {row[k + 1]} %", ABOVE_0, measured))
    return claims


def _modules(networks: Networks, f1: Statistic) -> list[Claim]:
    claims = []
    for module in MODULES:
        gain = ABLATION[module][0] - ABLATION[""][0]
        words = f"{module.upper()} alone improves the baseline at 0 s"
        claims.append(_ahead("modules", words, f"{gain:+.1f} points", f1, networks, f"modules-{module}", BASELINE))
    gain = ABLATION["rsf+cpe+fsn"][0] - ABLATION[""][0]
    words = "The three modules together improve the baseline at 0 s"
    return [*claims, _ahead("modules", words, f"{gain:+.1f} points", f1, networks, COMPLETE.name, BASELINE)]


def _others(stages: Mapping[str, Networks], f1: Statistic) -> list[Claim]:
    """Return the claims that the paper's own choice is better than each other one that it compares."""
    claims = []
    ahead = {order: f"{ORDERS['rsf-cpe-fsn'][0] - row[0]:+.1f} points" for order, row in ORDERS.items()}
    choices = (
        ("attention", "attention-", "the attention `bda`"),
        ("orders", "order-", "the order rsf-cpe-fsn"),
        ("alpha", "alpha-", f"alpha {BEST_ALPHA}"),
    )
    for stage, prefix, choice in choices:
        networks = stages.get(stage, {})
        for name in networks:
            if name == COMPLETE.name:
                continue
            other = name.removeprefix(prefix)
            words = f"At 0 s, {choice} is better than {other}"
            paper = ahead.get(other, "better, in a figure without numbers")
            claims.append(_ahead(stage, words, paper, f1, networks, COMPLETE.name, name))
    return claims


def _ahead(family: str, words: str, paper: str, f1: Statistic, networks: Networks, first: str, second: str) -> Claim:
    """Return the claim that the F1 of the first network at 0 s is above that of the second."""
    if first not in networks or second not in networks:
        return judged(family, words, paper, ABOVE_0, None)
    pair = networks[first][0], networks[second][0]
    return judged(family, words, paper, ABOVE_0, estimate(difference(f1), *pair), min(map(len, pair)))
