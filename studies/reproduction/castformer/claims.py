"""What the CaSTFormer paper claims, checked against the scores of the stages."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise

from isac_cosim.evaluation.on_windows.maneuvers import maneuver_statistic
from isac_cosim.evaluation.statistics import Estimate, Statistic, Trainings, difference, estimate
from isac_cosim.studies.reproduction.castformer.variants import COMPLETE, MODULES
from isac_cosim.studies.reproduction.experiments.paper_figures import (
    ABLATION,
    BEST_ALPHA,
    HORIZON,
    HORIZONS_S,
    ORDERS,
    end_of,
)
from isac_cosim.studies.reproduction.experiments.stages import Claim, above

Networks = Mapping[str, Mapping[int, Trainings]]
"""Confusion matrices by network and horizon, s."""
ABOVE_0 = "the difference in F1 is above 0"


def castformer_claims(stages: Mapping[str, Networks], background: int | None = None) -> list[Claim]:
    """Return every claim with its verdict.

    stages: the networks of each stage that was run. background: the class that is no maneuver, if there is one.
    """
    f1 = maneuver_statistic("f1", background)
    horizon, modules = stages.get("horizon", {}), stages.get("ablation", {})
    return [*_horizon(horizon, f1), *_modules(modules, f1), *_others(stages, f1)]


def _horizon(networks: Networks, f1: Statistic) -> list[Claim]:
    claims = []
    row = HORIZON["CaSTFormer"]
    for k, (near, far) in enumerate(pairwise(HORIZONS_S)):
        measured = None
        if COMPLETE.name in networks:
            at = networks[COMPLETE.name]
            measured = estimate(difference(f1), at[near], at[far])
        claims.append(
            _improves(f"F1 declines from {end_of(near)} to {end_of(far)}", f"{row[k]} % to {row[k + 1]} %", measured)
        )
    return claims


def _modules(networks: Networks, f1: Statistic) -> list[Claim]:
    claims = []
    for module in MODULES:
        measured = _ahead(f1, networks, f"modules-{module}", "modules-none")
        gain = ABLATION[module][0] - ABLATION[""][0]
        claims.append(
            _improves(f"{module.upper()} alone improves the baseline at 0 s", f"{gain:+.1f} points", measured)
        )
    measured = _ahead(f1, networks, COMPLETE.name, "modules-none")
    gain = ABLATION["rsf+cpe+fsn"][0] - ABLATION[""][0]
    together = "The three modules together improve the baseline at 0 s"
    return [*claims, _improves(together, f"{gain:+.1f} points", measured)]


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
            measured = _ahead(f1, networks, COMPLETE.name, name)
            claims.append(
                _improves(
                    f"At 0 s, {choice} is better than {other}",
                    ahead.get(other, "better, in a figure without numbers"),
                    measured,
                )
            )
    return claims


def _improves(claim: str, paper: str, measured: Estimate | None) -> Claim:
    """Return the claim that a difference is above 0."""
    return Claim(claim=claim, paper=paper, rule=ABOVE_0, measured=measured, verdict=above(measured))


def _ahead(f1: Statistic, networks: Networks, first: str, second: str, horizon_s: int = 0) -> Estimate | None:
    """Return the F1 of the first network minus that of the second, None where one of them was not run."""
    if first not in networks or second not in networks:
        return None
    return estimate(difference(f1), networks[first][horizon_s], networks[second][horizon_s])
