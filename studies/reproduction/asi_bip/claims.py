"""What the ASI-BIP paper claims, checked against the scores of the stages."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from isac_cosim.base.arrays import Array
from isac_cosim.evaluation.on_windows.metrics import class_f1, lead_of_others, lead_over_others, mean_f1
from isac_cosim.evaluation.statistics import (
    Estimate,
    Statistic,
    Trainings,
    between_0_and_1,
    difference,
    estimate,
    of_left_out,
    over_trainings,
    relative_gain,
    span,
)
from isac_cosim.labeling.intentions import KNOWN, Intention
from isac_cosim.models.scores import open_set
from isac_cosim.studies.reproduction.experiments.paper_figures import CASES, CLASS_F1, UNKNOWN_AUROC, WEATHER_GAIN
from isac_cosim.studies.reproduction.experiments.unknown_class import UnknownScores
from isac_cosim.studies.reproduction.experiments.verdicts import (
    Claim,
    all_of,
    corrected,
    is_above,
    is_at_most,
    is_within,
    judged,
)

ALIKE = 0.02
"""Scores that differ by no more than this are alike: for claims that something does not change."""
MUCH = 0.1
"""A score is much, or well, above another one by more than this."""
MODEST_AUROC = (0.5, 0.8)
"""From chance to where discrimination is called excellent (Hosmer & Lemeshow 2000, Section 5.2.4)."""
SETTLED_DB = 10.0
"""From this SNR on, scores should no longer change; the trainings saw none above it."""
ORDER = (
    ("truth", "isac", 1, 2),
    ("radar-clear", "isac", 3, 2),
    ("radar-clear", "radar-nlos", 3, 4),
    ("isac", "radar-weather", 2, 5),
)
"""Pairs of cases of which the paper ranks the first higher, with their numbers in Table I."""
PARABOLA = {
    "isac": "isac-padded-parabola-loss",
    "radar-clear": "framework-clear",
    "radar-nlos": "framework-nlos",
    "radar-weather": "framework-weather",
}
"""One set of assumptions, by the cases of this project's own sensing: a padded grid with a parabola and Eq. (5), a
radar at 400 Hz, and, as the paper has it, ISAC "under the same adverse weather" as the radar, a loss of 20 dB."""
IMPROVES = is_above("the difference in macro-F1 is above 0")


def asi_bip_claims(
    cases: Mapping[str, Trainings], by_snr: Mapping[float, Trainings], unknown: Sequence[UnknownScores] = ()
) -> list[Claim]:
    """Return every claim with its verdict.

    cases: confusion matrices by way of sensing (`aligned` included); those of stages that were not run are absent.
    by_snr: of the ISAC case by test SNR, dB. unknown: separation of `following`, by training.
    """
    return corrected(
        [
            *(_ranked(cases, *pair) for pair in ORDER),
            _nlos_alike(cases, "isac", "radar-nlos"),
            *(
                _ranked(cases, PARABOLA.get(first, first), PARABOLA[second], *numbers, family="parabola")
                for first, second, *numbers in ORDER
            ),
            _nlos_alike(cases, PARABOLA["isac"], PARABOLA["radar-nlos"], family="parabola"),
            _weather_gain(cases, PARABOLA["isac"], PARABOLA["radar-weather"], "parabola"),
            *(_weather_gain(cases, weather) for weather in ("isac-rain", "isac-loss", "isac-padded-grid-rain")),
            *_by_intention(cases),
            *_unknown(unknown),
            *_by_snr(by_snr),
            *_asynchronous(cases),
        ]
    )


def _ranked(cases: Mapping[str, Trainings], first: str, second: str, *numbers: int, family: str = "order") -> Claim:
    paper = CASES[numbers[0]][1] - CASES[numbers[1]][1]
    words = f"Order of the cases: {first} is better than {second}"
    measured = _compared(cases, difference(mean_f1), first, second)
    return judged(family, words, f"macro-F1 {paper:+.4f}", IMPROVES, measured, _fewest(cases, first, second))


def _nlos_alike(cases: Mapping[str, Trainings], *pair: str, family: str = "order") -> Claim:
    return judged(
        family,
        f"Order of the cases: {pair[0]} is comparable to {pair[1]}",
        f"macro-F1 {CASES[2][1] - CASES[4][1]:+.4f}",
        is_within(f"the difference in macro-F1 is within ±{ALIKE}", ALIKE),
        _compared(cases, difference(mean_f1), *pair),
        _fewest(cases, *pair),
    )


def _weather_gain(
    cases: Mapping[str, Trainings], weather: str, radar: str = "radar-weather", family: str = "weather"
) -> Claim:
    pair = weather, radar
    return judged(
        family,
        f"Relative gain of ISAC over the radar in adverse weather ({weather})",
        f"{WEATHER_GAIN:.1%} of macro-F1",
        is_above(f"the gain is above {WEATHER_GAIN}", WEATHER_GAIN),
        _compared(cases, relative_gain(mean_f1), *pair),
        _fewest(cases, *pair),
    )


def _by_intention(cases: Mapping[str, Trainings]) -> list[Claim]:
    brake, accel, overtake = (
        int(intention) for intention in (Intention.HARD_BRAKE, Intention.HARD_ACCEL, Intention.OVERTAKE)
    )

    def accel_over_brake(counts: Array) -> float:
        return class_f1(accel)(counts) - class_f1(brake)(counts)

    checked = (
        (
            "The hard brake is the weakest intention",
            f"F1 {CLASS_F1['hard_brake']}, the lowest",
            is_above("the lowest F1 of the others minus that of the hard brake is above 0"),
            lead_of_others(brake),
        ),
        (
            "The overtake is the best intention",
            f"F1 {CLASS_F1['overtake']:.1f}, the highest",
            is_above("the F1 of the overtake minus the highest of the others is above 0"),
            lead_over_others(overtake),
        ),
        (
            "The hard accel is well above the hard brake",
            f"F1 {CLASS_F1['hard_accel']} against {CLASS_F1['hard_brake']}",
            is_above(f"the difference in F1 is above {MUCH}", MUCH),
            accel_over_brake,
        ),
    )
    return [
        judged("fig3", words, paper, rule, _compared(cases, statistic, "isac"), _fewest(cases, "isac"))
        for words, paper, rule, statistic in checked
    ]


def _unknown(unknown: Sequence[UnknownScores]) -> list[Claim]:
    low, high = MODEST_AUROC
    modest = is_within(
        f"the AUROC by the largest probability is from {low} to {high}", (high - low) / 2, (low + high) / 2
    )
    return [
        judged(
            "fig4",
            "The separation of `following` is modest",
            f"AUROC {UNKNOWN_AUROC}",
            modest,
            _auroc(unknown),
            len(unknown),
        ),
        judged(
            "fig4",
            "Most of `following` is identified as unknown",
            "most, in a figure without numbers",
            is_above("the share of `following` below the threshold is above 0.5", 0.5),
            _of_confusion(unknown, _identified),
            len(unknown),
        ),
        judged(
            "fig4",
            "The hard brake and the swerve are most often taken for unknown",
            "often, in a figure without numbers",
            is_above("the lower share of the two minus the highest of the others is above 0"),
            _of_confusion(unknown, _brake_and_swerve_ahead),
            len(unknown),
        ),
    ]


def _auroc(unknown: Sequence[UnknownScores]) -> Estimate | None:
    areas = [scores.auroc.get(open_set.PLAIN) for scores in unknown]
    known = [area for area in areas if area is not None]
    if not known or len(known) < len(areas):
        return None
    left_out = np.array([scores.auroc_without.get(open_set.PLAIN, []) for scores in unknown])
    return between_0_and_1(of_left_out(np.array(known), left_out))


def _of_confusion(unknown: Sequence[UnknownScores], statistic: Statistic) -> Estimate | None:
    """Return a statistic of the confusion matrices with the unknown class.

    Where a training's matrices by test seed are not stored, the interval covers the trainings alone.
    """
    if not unknown:
        return None
    if all(scores.confusion_by_seed for scores in unknown):
        return estimate(statistic, [scores.confusion_by_seed for scores in unknown])
    return over_trainings(np.array([statistic(np.array(scores.confusion)) for scores in unknown]))


def _rejected(counts: Array) -> Array:
    """Return the share of each class that is taken for unknown, (G,); counts: with the unknown class last."""
    return np.asarray(counts[:, -1] / np.maximum(counts.sum(axis=1), 1))


def _identified(counts: Array) -> float:
    return float(_rejected(counts)[-1])


def _brake_and_swerve_ahead(counts: Array) -> float:
    named = [int(Intention.HARD_BRAKE), int(Intention.EVASIVE_SWERVE)]
    shares = _rejected(counts)[: len(KNOWN)]
    return float(shares[named].min() - np.delete(shares, named).max())


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
    trainings = min(map(len, conditions), default=0)
    at_most_alike = is_at_most(f"its largest F1 minus its smallest is at most {ALIKE}", ALIKE)
    settled = is_within(f"it improves before, and the difference in macro-F1 is then within ±{ALIKE}", ALIKE)
    improves = judged("fig5", f"F1 improves with the SNR{before}", "improves", IMPROVES, rise, trainings)
    saturates = judged("fig5", f"F1 saturates after an improvement{after}", "saturates", settled, rest, trainings)
    both = [part.p_value for part in (improves, saturates) if part.p_value is not None]
    return [
        judged(
            "fig5",
            f"The overtake is immune to the SNR{whole}",
            f"F1 {CLASS_F1['overtake']:.1f} at every SNR",
            at_most_alike,
            immune,
            trainings,
        ),
        improves,
        saturates.model_copy(
            update={
                "verdict": all_of([improves.verdict, saturates.verdict]),
                "p_value": max(both) if len(both) == 2 else None,
            }
        ),
    ]


def _asynchronous(cases: Mapping[str, Trainings]) -> list[Claim]:
    than = {
        "aligned": "aligned fusion",
        "control-slow": "ASI-BIP with the TV resampled to 100 Hz",
        "control-fast": "ASI-BIP with the UV interpolated to 400 Hz",
    }
    return [
        judged(
            "fusion",
            f"Asynchronous fusion is better than {words}",
            "claimed without a number",
            IMPROVES,
            _compared(cases, difference(mean_f1), "isac", name),
            _fewest(cases, "isac", name),
        )
        for name, words in than.items()
    ]


def _compared(cases: Mapping[str, Trainings], statistic: Statistic, *names: str) -> Estimate | None:
    """Return a statistic of some cases, None where one of them was not run."""
    if any(name not in cases for name in names):
        return None
    return estimate(statistic, *(cases[name] for name in names))


def _fewest(cases: Mapping[str, Trainings], *names: str) -> int:
    """Return the number of trainings of the case that has the fewest, 0 where one was not run."""
    return min(len(cases.get(name, ())) for name in names)
