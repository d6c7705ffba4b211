"""What an evaluation lets one say in words: which run is ahead, and whether there is reason to believe it."""

from __future__ import annotations

from isac_cosim.evaluation.on_windows.results import ComparedResult, EvaluationResult, PredictorResult
from isac_cosim.evaluation.on_windows.score_results import LEAST_FOR_VERDICT, Difference, PairedDifference
from isac_cosim.labeling.intentions import over_text

SINGLE_SEED = "All scores are of a single test seed: nothing can be said about other traffic."


def verdict(result: EvaluationResult) -> list[str]:
    """Return one sentence for each compared run: which of the two is ahead before the commit, if it can be said.

    Where runs differ in the training seed alone, also one sentence for each group of such runs. A single test seed is
    pointed out first.
    """
    groups = result.over_training_seeds or []
    return [
        *([SINGLE_SEED] if result.groups == 1 else []),
        *(_comparison(result.name, other) for other in result.compared),
        *(_group_sentence(groups[0].name, group, result) for group in groups),
    ]


def headline_difference(result: ComparedResult | PredictorResult) -> PairedDifference | None:
    """Return the paired difference before the commit, or on all windows for results of earlier versions."""
    return result.paired_difference_before_commit or result.paired_difference


def seeds_text(count: int) -> str:
    """Return a number of test seeds in words."""
    return f"{count} test seed" + ("" if count == 1 else "s")


def difference_text(paired: PairedDifference, interval: Difference) -> str:
    """Return a difference with its interval; interval: one of those in `paired`."""
    if interval.difference is None:
        return "-"
    if not paired.has_interval or interval.low is None or _is_all(interval):
        return f"{interval.difference:+.3f} (no interval)"
    return f"{interval.difference:+.3f} ({interval.low:+.3f} to {interval.high:+.3f})"


def _is_all(interval: Difference) -> bool:
    """Return whether an interval holds every difference there can be, and so says nothing."""
    return interval.low is not None and interval.high is not None and interval.low <= -1 and interval.high >= 1


def _comparison(name: str, other: ComparedResult) -> str:
    """Return which of two runs is ahead; name: of the evaluated one."""
    paired = headline_difference(other)
    score = "macro-F1" if other.paired_difference_before_commit is None else "macro-F1 before the commit"
    score += over_text(None if paired is None else paired.macro_f1_over, other.classes)
    if paired is None or paired.macro_f1.difference is None:
        return f"{name} and {other.name} cannot be compared: {score} is undefined."
    gap, seeds = paired.macro_f1, seeds_text(paired.groups)
    size = f"{abs(paired.macro_f1.difference):.3f} {score}"
    if not paired.has_interval:
        return (
            f"{name} and {other.name} differ by {size}, "
            "but with a single test seed nothing can be said about the difference."
        )
    if not paired.allows_verdict:
        return (
            f"{name} and {other.name} differ by {size}, "
            f"but {seeds} are too few to say which is better: it takes {LEAST_FOR_VERDICT} at least."
        )
    if gap.low is None or gap.high is None:
        return f"{name} and {other.name} differ by {size}, but the interval over {seeds} is undefined."
    ahead, behind = (name, other.name) if paired.macro_f1.difference >= 0 else (other.name, name)
    doubt = "" if gap.low > 0 or gap.high < 0 else ", but the interval includes 0"
    # A name may be a plural, "boosted trees", and may begin small.
    return f"{ahead[:1].upper()}{ahead[1:]} came out ahead of {behind} by {size} ({seeds}){doubt}."


def _group_sentence(first_name: str, group: PredictorResult, result: EvaluationResult) -> str:
    """Return mean and spread of a predictor over its training seeds.

    first_name: of the first predictor. result: of the evaluation, whose windows are those of all predictors.
    """
    score, name = group.before_commit_macro_f1, "macro-F1 before the commit"
    over = None if result.before_commit is None else result.before_commit.macro_f1_over
    if score is None:
        score, name, over = group.macro_f1, "macro-F1", result.macro_f1_over
    name += over_text(over, result.classes)
    mean = "-" if score.mean is None else f"{score.mean:.3f}"
    spread = "" if score.sd is None else f", standard deviation {score.sd:.3f}"
    paired = headline_difference(group)
    difference = "" if paired is None else f"; {first_name} minus it {difference_text(paired, paired.macro_f1)}"
    return f"{group.name}, {score.n} training seed(s): {name} {mean}{spread}{difference}."
