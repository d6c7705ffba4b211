"""The checklist of the ASI-BIP paper, on made-up confusion matrices."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import t

from isac_cosim.evaluation.statistics import Trainings
from isac_cosim.labeling.intentions import KNOWN, Intention
from isac_cosim.studies.reproduction.asi_bip.claims import PARABOLA, asi_bip_claims
from isac_cosim.studies.reproduction.experiments.sensing_cases import TRAINED, weather_cases
from isac_cosim.studies.reproduction.experiments.unknown_class import BINS, RATES, UnknownScores
from isac_cosim.studies.reproduction.experiments.verdicts import Verdict


def counts(right: int, weakest: Intention | None = None) -> Trainings:
    """`right` of 100 windows of each intention are predicted correctly, on four seeds that differ a little."""
    condition = {}
    for seed in range(4):
        matrix = [[0] * len(KNOWN) for _ in KNOWN]
        for k in range(len(KNOWN)):
            hit = min(100, right - (20 if k == weakest else 0) + seed % 2)
            matrix[k][k] = hit
            matrix[k][(k + 1) % len(KNOWN)] += 100 - hit
        condition[f"road-{seed}"] = matrix
    # Trained twice, alike: one training decides nothing.
    return [condition, condition]


def verdicts(cases: dict[str, Trainings], by_snr: dict[float, Trainings]) -> dict[str, Verdict]:
    return {claim.claim: claim.verdict for claim in asi_bip_claims(cases, by_snr)}


AS_THE_PAPER_SAYS = {
    "truth": counts(95),
    "isac": counts(88, Intention.HARD_BRAKE),
    "radar-clear": counts(93),
    "radar-nlos": counts(85),
    "radar-weather": counts(60),
    "isac-rain": counts(88),
    "isac-loss": counts(62),
    "aligned": counts(50),
}


def test_verdicts_follow_the_figures() -> None:
    by_snr = {-30.0: counts(40), 0.0: counts(80), 10.0: counts(88), 20.0: counts(88)}
    by_claim = verdicts(AS_THE_PAPER_SAYS, by_snr)
    assert by_claim["Order of the cases: truth is better than isac"] == "holds"
    assert by_claim["Order of the cases: isac is better than radar-weather"] == "holds"
    assert by_claim["Relative gain of ISAC over the radar in adverse weather (isac-rain)"] == "holds"
    assert by_claim["Relative gain of ISAC over the radar in adverse weather (isac-loss)"] == "does not hold"
    assert by_claim["Relative gain of ISAC over the radar in adverse weather (isac-padded-grid-rain)"] == "undecided"
    assert by_claim["The hard brake is the weakest intention"] == "holds"
    assert by_claim["The overtake is the best intention"] == "undecided"
    assert by_claim["The hard accel is well above the hard brake"] == "holds"
    assert by_claim["The overtake is immune to the SNR (-30 to 20 dB)"] == "does not hold"
    assert by_claim["F1 improves with the SNR (-30 to 10 dB)"] == "holds"
    assert by_claim["F1 saturates after an improvement (10 to 20 dB)"] == "holds"
    assert by_claim["Asynchronous fusion is better than aligned fusion"] == "holds"


def test_verdicts_against_the_paper() -> None:
    cases = {name: counts(80) for name in AS_THE_PAPER_SAYS} | {"truth": counts(70), "aligned": counts(90)}
    by_claim = verdicts(cases, {0.0: counts(80), 20.0: counts(80)})
    assert by_claim["Order of the cases: truth is better than isac"] == "does not hold"
    assert by_claim["Order of the cases: isac is comparable to radar-nlos"] == "holds"
    assert by_claim["Asynchronous fusion is better than aligned fusion"] == "does not hold"
    assert by_claim["The overtake is immune to the SNR (0 to 20 dB)"] == "holds"


def test_nothing_is_told_of_stages_that_were_not_run() -> None:
    assert set(verdicts({}, {}).values()) == {"undecided"}


def unknown(identified: int, rejected: dict[Intention, int], auroc: float, by_seed: bool = True) -> UnknownScores:
    """`identified` of 50 windows of `following` and some of 50 of each intention count as unknown, on five seeds."""
    matrix = np.zeros((7, 7), dtype=int)
    for k in range(7):
        away = identified if k == 6 else rejected.get(Intention(k), 0)
        matrix[k, 6], matrix[k, 0 if k == 6 else k] = away, 50 - away
    seeds = {f"road-{seed}": (matrix + np.eye(7, dtype=int) * (seed % 2)).tolist() for seed in range(5)}
    return UnknownScores(
        n_known=300, n_unknown=50, auroc={"msp": auroc}, auroc_without={"msp": [auroc, auroc + 0.001, auroc]},
        roc={"msp": [0.5] * RATES}, known_confidence=[1] * BINS, unknown_confidence=[1] * BINS, threshold=0.4,
        confusion=np.sum(list(seeds.values()), axis=0).tolist(), confusion_by_seed=seeds if by_seed else {},
    )  # fmt: skip


FIG_4 = (
    "The separation of `following` is modest",
    "Most of `following` is identified as unknown",
    "The hard brake and the swerve are most often taken for unknown",
)


def test_the_claims_of_the_fourth_figure() -> None:
    often = {Intention.HARD_BRAKE: 20, Intention.EVASIVE_SWERVE: 18, Intention.OVERTAKE: 2}
    as_claimed = [unknown(40, often, 0.7), unknown(41, often, 0.71)]
    found = {c.claim: c.verdict for c in asi_bip_claims({}, {}, as_claimed)}
    assert [found[name] for name in FIG_4] == ["holds"] * 3
    seldom = {Intention.LEFT_LANE_CHANGE: 20}
    found = {c.claim: c.verdict for c in asi_bip_claims({}, {}, [unknown(10, seldom, 0.95), unknown(11, seldom, 0.95)])}
    assert [found[name] for name in FIG_4] == ["does not hold"] * 3


def test_without_counts_by_seed_the_interval_is_over_the_trainings() -> None:
    shares = [20, 35, 25]
    claims = asi_bip_claims({}, {}, [unknown(k, {}, 0.9, by_seed=False) for k in shares])
    measured = next(c.measured for c in claims if c.claim == FIG_4[1])
    assert measured is not None
    shown = [unknown(k, {}, 0.9).confusion[6] for k in shares]
    expected = t.interval(0.95, 2, *_mean_and_error([row[6] / sum(row) for row in shown]))
    assert (measured.low, measured.high) == pytest.approx(expected)


def _mean_and_error(values: list[float]) -> tuple[float, float]:
    return float(np.mean(values)), float(np.std(values, ddof=1) / np.sqrt(len(values)))


def test_claims_of_the_other_assumptions_ask_for_cases_that_there_are() -> None:
    """A claim of a case that no stage measures would stay undecided for ever."""
    measured = {case.name for case in [*TRAINED, *weather_cases("isac-padded-parabola")]}
    assert set(PARABOLA.values()) < measured
