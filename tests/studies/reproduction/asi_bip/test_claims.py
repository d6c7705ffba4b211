"""The checklist of the ASI-BIP paper, on made-up confusion matrices."""

from __future__ import annotations

from isac_cosim.evaluation.statistics import Trainings
from isac_cosim.labeling.intentions import KNOWN, Intention
from isac_cosim.studies.reproduction.asi_bip.claims import asi_bip_claims
from isac_cosim.studies.reproduction.experiments.stages import Verdict


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
    return [condition]


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
