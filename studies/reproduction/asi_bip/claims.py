"""What the ASI-BIP paper claims, checked against the scores of the stages."""

from __future__ import annotations

from collections.abc import Mapping

from isac_cosim.evaluation.on_windows.metrics import class_f1, lead_of_others, mean_f1
from isac_cosim.evaluation.statistics import Estimate, Statistic, Trainings, difference, estimate, relative_gain, span
from isac_cosim.labeling.intentions import Intention
from isac_cosim.studies.reproduction.experiments.paper_figures import CASES, WEATHER_GAIN
from isac_cosim.studies.reproduction.experiments.stages import Claim, above, all_of, at_most, within

ALIKE = 0.02
"""Scores that differ by no more than this are alike: for claims that something does not change."""
SETTLED_DB = 10.0
"""From this SNR on, scores should no longer change; the trainings saw none above it."""
ORDER = (
    ("truth", "isac", 1, 2),
    ("radar-clear", "isac", 3, 2),
    ("radar-clear", "radar-nlos", 3, 4),
    ("isac", "radar-weather", 2, 5),
)
"""Pairs of cases of which the paper ranks the first higher, with their numbers in Table I."""


def asi_bip_claims(cases: Mapping[str, Trainings], by_snr: Mapping[float, Trainings]) -> list[Claim]:
    """Return every claim with its verdict.

    cases: confusion matrices by way of sensing (`aligned` included); those of stages that were not run are absent.
    by_snr: of the ISAC case by test SNR, dB.
    """
    return [
        *(_ranked(cases, *pair) for pair in ORDER),
        _nlos_alike(cases),
        *(_weather_gain(cases, weather) for weather in ("isac-rain", "isac-loss", "isac-padded-grid-rain")),
        _weakest(cases),
        *_by_snr(by_snr),
        _asynchronous(cases),
    ]


def _ranked(cases: Mapping[str, Trainings], first: str, second: str, *numbers: int) -> Claim:
    measured = _compared(cases, difference(mean_f1), first, second)
    paper = CASES[numbers[0]][1] - CASES[numbers[1]][1]
    return Claim(
        claim=f"Order of the cases: {first} is better than {second}",
        paper=f"macro-F1 {paper:+.4f}",
        rule="the difference in macro-F1 is above 0",
        measured=measured,
        verdict=above(measured),
    )


def _nlos_alike(cases: Mapping[str, Trainings]) -> Claim:
    measured = _compared(cases, difference(mean_f1), "isac", "radar-nlos")
    return Claim(
        claim="Order of the cases: isac is comparable to radar-nlos",
        paper=f"macro-F1 {CASES[2][1] - CASES[4][1]:+.4f}",
        rule=f"the difference in macro-F1 is within ±{ALIKE}",
        measured=measured,
        verdict=within(measured, ALIKE),
    )


def _weather_gain(cases: Mapping[str, Trainings], weather: str) -> Claim:
    measured = _compared(cases, relative_gain(mean_f1), weather, "radar-weather")
    return Claim(
        claim=f"Relative gain of ISAC over the radar in adverse weather ({weather})",
        paper=f"{WEATHER_GAIN:.1%} of macro-F1",
        rule=f"the gain is above {WEATHER_GAIN}",
        measured=measured,
        verdict=above(measured, WEATHER_GAIN),
    )


def _weakest(cases: Mapping[str, Trainings]) -> Claim:
    measured = _compared(cases, lead_of_others(int(Intention.HARD_BRAKE)), "isac")
    return Claim(
        claim="The hard brake is the weakest intention",
        paper="F1 0.7568, the lowest",
        rule="the lowest F1 of the others minus that of the hard brake is above 0",
        measured=measured,
        verdict=above(measured),
    )


def _by_snr(by_snr: Mapping[float, Trainings]) -> list[Claim]:
    levels = sorted(by_snr)
    low, high = (levels[0], levels[-1]) if levels else (0.0, 0.0)
    conditions = [by_snr[level] for level in levels]
    overtake = class_f1(int(Intention.OVERTAKE))
    immune = estimate(span(overtake), *conditions) if levels else None
    near = max((level for level in levels if level <= SETTLED_DB), default=high)
    rise = estimate(difference(mean_f1), by_snr[near], by_snr[low]) if levels else None
    rest = estimate(difference(mean_f1), by_snr[high], by_snr[near]) if levels else None
    whole, before, after = (
        (f" ({first:g} to {last:g} dB)" if levels else "") for first, last in ((low, high), (low, near), (near, high))
    )
    return [
        Claim(
            claim=f"The overtake is immune to the SNR{whole}",
            paper="F1 1.0 at every SNR",
            rule=f"its largest F1 minus its smallest is at most {ALIKE}",
            measured=immune,
            verdict=at_most(immune, ALIKE),
        ),
        Claim(
            claim=f"F1 improves with the SNR{before}",
            paper="improves",
            rule="the difference in macro-F1 is above 0",
            measured=rise,
            verdict=above(rise),
        ),
        Claim(
            claim=f"F1 saturates after an improvement{after}",
            paper="saturates",
            rule=f"it improves before, and the difference in macro-F1 is then within ±{ALIKE}",
            measured=rest,
            verdict=all_of([above(rise), within(rest, ALIKE)]),
        ),
    ]


def _asynchronous(cases: Mapping[str, Trainings]) -> Claim:
    measured = _compared(cases, difference(mean_f1), "isac", "aligned")
    return Claim(
        claim="Asynchronous fusion is better than aligned fusion",
        paper="claimed without a number",
        rule="the difference in macro-F1 is above 0",
        measured=measured,
        verdict=above(measured),
    )


def _compared(cases: Mapping[str, Trainings], statistic: Statistic, *names: str) -> Estimate | None:
    """Return a statistic of some cases, None where one of them was not run."""
    if any(name not in cases for name in names):
        return None
    return estimate(statistic, *(cases[name] for name in names))
