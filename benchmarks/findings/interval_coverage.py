"""How often intervals over few scenario seeds cover the true macro-F1: the jackknife with a t quantile, and bootstraps.

Simulated test sets: seeds differ in size and in difficulty, and half of the records give the same answer for all of
their windows, so that windows are not independent.

Run: python -m isac_cosim.benchmarks.findings.interval_coverage
"""

from __future__ import annotations

import numpy as np

from isac_cosim.base.arrays import Array
from isac_cosim.base.files import json_text
from isac_cosim.evaluation.on_windows import metrics
from isac_cosim.evaluation.statistics import jackknife_half_width

RATES = np.array(
    [
        [0.86, 0.02, 0.02, 0.02, 0.02, 0.06],
        [0.01, 0.76, 0.02, 0.19, 0.01, 0.01],
        [0.01, 0.04, 0.91, 0.01, 0.01, 0.02],
        [0.01, 0.28, 0.01, 0.68, 0.01, 0.01],
        [0.02, 0.01, 0.01, 0.01, 0.94, 0.01],
        [0.04, 0.05, 0.04, 0.01, 0.01, 0.85],
    ]
)
"""Mean rates of predicted intentions, rows true: overtakes are mistaken for left changes."""
SHARES = np.array([0.2, 0.22, 0.2, 0.14, 0.08, 0.16])
"""Share of each intention among the records."""
RECORDS = 20
"""Median number of records of a seed."""
ENDS = 4
"""Windows of each record."""
CONCENTRATION = 15.0
"""Parameter of the Dirichlet distribution of a seed's rates: the smaller, the more seeds differ."""


def traffic(rng: np.random.Generator, repetitions: int, groups: int, predictors: int = 1) -> Array:
    """Return confusion matrices (predictors, repetitions, groups, G, G) of simulated test sets.

    All predictors see the same records, and are equally good on each seed.
    """
    size = RECORDS * np.exp(rng.normal(0, 0.4, (repetitions, groups)))
    records = np.stack([rng.poisson(size * share) for share in SHARES], axis=-1)
    rates = rng.gamma(np.broadcast_to(CONCENTRATION * RATES, (repetitions, groups, *RATES.shape)))
    rates /= rates.sum(axis=-1, keepdims=True)
    drawn = []
    for _ in range(predictors):
        alike = rng.binomial(records, 0.5)
        drawn.append(ENDS * rng.multinomial(alike, rates) + rng.multinomial(ENDS * (records - alike), rates))
    return np.stack(drawn).astype(np.float64)


def true_macro_f1(rng: np.random.Generator) -> float:
    """Return the macro-F1 of endless traffic."""
    return float(metrics.macro_f1(traffic(rng, 400, 400)[0].sum(axis=(0, 1))))


def coverage(groups: int, repetitions: int = 1500, seed: int = 1) -> float:
    """Return how often the interval of a macro-F1 covers the true one."""
    rng = np.random.default_rng(seed)
    truth, drawn = true_macro_f1(rng), traffic(rng, repetitions, groups)[0]
    bounds = np.array([metrics.macro_f1_interval(counts)[1:] for counts in drawn], dtype=np.float64)
    return float(np.mean((bounds[:, 0] <= truth) & (truth <= bounds[:, 1])))


def coverage_of_difference(groups: int, repetitions: int = 3000, seed: int = 2) -> float:
    """Return how often the interval of the difference of two equally good predictors includes 0."""
    first, second = traffic(np.random.default_rng(seed), repetitions, groups, predictors=2)
    totals = first.sum(axis=1), second.sum(axis=1)
    difference = metrics.macro_f1(totals[0]) - metrics.macro_f1(totals[1])
    left_out = np.stack(
        [metrics.macro_f1(totals[0] - first[:, g]) - metrics.macro_f1(totals[1] - second[:, g]) for g in range(groups)]
    )
    return float(np.mean(np.abs(difference) <= jackknife_half_width(left_out)))


def coverage_of_bootstrap(groups: int, repetitions: int = 300, draws: int = 400, seed: int = 1) -> float:
    """Return the same for the percentile bootstrap over scenario seeds."""
    rng = np.random.default_rng(seed)
    truth, covered = true_macro_f1(rng), []
    for counts in traffic(rng, repetitions, groups)[0]:
        weights = rng.multinomial(groups, np.full(groups, 1 / groups), draws)
        low, high = np.quantile(metrics.macro_f1(np.einsum("dg,gij->dij", weights, counts)), [0.025, 0.975])
        covered.append(low <= truth <= high)
    return float(np.mean(covered))


def main() -> None:
    """Print the coverage of 95 % intervals at several numbers of seeds."""
    for groups in (3, 8, 20):
        shares = {
            "jackknife": coverage(groups, 4000),
            "jackknife_of_difference": coverage_of_difference(groups, 4000),
            "bootstrap": coverage_of_bootstrap(groups, 2000),
        }
        print(json_text({"seeds": groups, **{name: round(share, 3) for name, share in shares.items()}}))


if __name__ == "__main__":
    main()
