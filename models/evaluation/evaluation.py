"""A run on the windows of a dataset: metrics.json and the figures."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import pandas as pd
from pydantic import Field
from scipy.special import softmax
from sklearn.metrics import roc_curve

from isacsim.arrays import Array, IntArray
from isacsim.errors import InputError
from isacsim.files import claim, write_json
from isacsim.settings import Settings
from isacsim.versions import OF_RUNS, versions
from labeling.intentions import Intention
from models.data.windows import Ends, Records, WindowSettings, draw_ends, end_bounds
from models.evaluation import metrics, repeats, unknown
from models.evaluation.predictions import Answers, answers, unseen
from models.evaluation.repeats import Measured
from models.networks.fitting import HISTORY_FILE
from models.report import figures
from models.run import Run
from models.scores import open_set
from models.scores.calibration import calibration_error

if TYPE_CHECKING:
    from labeling.dataset.dataset import Dataset

METRICS_FILE = "metrics.json"


class SweepSettings(Settings):
    """Fixed window ends that a predictor is measured at, one after the other."""

    relative_to: Literal["onset", "commit"] = Field("onset", description="the instant that the ends are counted from")
    first_s: float = Field(-0.5, description="first end after that instant, s; negative is before it")
    last_s: float = Field(2.2, description="no end is later, s")
    step_s: float = Field(0.2, gt=0, description="between ends, s")

    @property
    def ends_s(self) -> list[float]:
        """The ends, s."""
        count = int(np.floor((self.last_s - self.first_s) / self.step_s + 1e-6)) + 1
        return [round(self.first_s + k * self.step_s, 6) for k in range(count)]


class EvaluateSettings(Settings):
    """Which windows a predictor is measured on."""

    ends_per_record: int = Field(4, ge=1, description="fixed windows of each record")
    seed: int = Field(0, description="of the window ends")
    end_after_s: tuple[float, float] | None = Field(None, description="range of window ends, s; none: as in training")
    sweep: SweepSettings | None = Field(None, description="measure at fixed window ends too, where given")


def evaluate(
    run: Run, dataset: Dataset, out: str | Path, settings: EvaluateSettings | None = None, against: Sequence[Run] = ()
) -> dict[str, Any]:
    """Measure a run on the seeds of a dataset that it was not trained or chosen on; writes metrics.json and figures.

    against: other runs on the same windows, e.g. floors, each with its paired difference. Runs among all of them that
    differ in the training seed alone are summed up in `over_training_seeds`, too. Returns the metrics.
    InputError where no such seed is left, the rates differ, or `out` holds something else.
    """
    made_of = {"digest": dataset.digest, "study": dataset.meta.study}
    return evaluate_records(run, Records.of(dataset), made_of, out, settings or EvaluateSettings(), against)


def evaluate_records(
    run: Run,
    records: Records,
    made_of: dict[str, Any],
    out: str | Path,
    settings: EvaluateSettings,
    against: Sequence[Run] = (),
) -> dict[str, Any]:
    """`evaluate` on records in memory."""
    with claim(Path(out), METRICS_FILE, "evaluation"):
        return _evaluate(run, records, made_of, Path(out), settings, against)


def _evaluate(
    run: Run,
    records: Records,
    made_of: dict[str, Any],
    folder: Path,
    settings: EvaluateSettings,
    against: Sequence[Run],
) -> dict[str, Any]:
    """Measure in a folder that is held."""
    records = unseen(records, [run, *against])
    windows = run.card.settings.windows
    if settings.end_after_s is not None:
        windows = WindowSettings.model_validate({**windows.model_dump(), "end_after_s": settings.end_after_s})
    ends = draw_ends(records, windows, "evaluate", settings.seed, per_record=settings.ends_per_record)
    everyone = [measured(each, records, ends, settings) for each in (run, *against)]
    _tell_apart(everyone)
    mine, result = everyone[0], everyone[0].found
    result["compared"] = [
        {**other.found, "paired_difference": repeats.difference([mine], [other])} for other in everyone[1:]
    ]
    if len(repeats.grouped(everyone)) < len(everyone):
        result["over_training_seeds"] = repeats.over_training_seeds(everyone)
    result["windows"] = {**windows.model_dump(mode="json"), **settings.model_dump(mode="json", exclude={"end_after_s"})}
    result["made_by"] = {
        "dataset": made_of,
        "seeds": sorted(set(records.groups)),
        "runs": [each.card.model_dump(mode="json") for each in (run, *against)],
        "versions": versions(OF_RUNS),
    }
    write_json(folder / METRICS_FILE, result)
    _draw(run, mine.given, result, [group[0].found for group in repeats.grouped(everyone)], folder)
    return result


def measured(run: Run, records: Records, ends: Ends, settings: EvaluateSettings) -> Measured:
    """The run's answers on those windows, and all its metrics."""
    given, scores = answers(run, records, ends), open_set.of_run(run)
    found = measure(run, given, scores) | swept(run, records, settings, scores[run.card.unknown_score])
    return Measured(run, given, found)


def _tell_apart(everyone: Sequence[Measured]) -> None:
    """Give runs of one model different names: the training seed's, and a number where that is the same, too."""
    for by_seed in (True, False):
        names = Counter(each.found["name"] for each in everyone)
        for k, each in enumerate(everyone):
            if names[each.found["name"]] > 1:
                each.found["name"] += f", seed {each.run.card.settings.seed}" if by_seed else f", {k + 1}"


def measure(run: Run, given: Answers, scores: Mapping[str, open_set.Score]) -> dict[str, Any]:
    """The metrics of one run's answers, by the contract's names; scores: all of the run."""
    classes, known = run.card.classes, given.known
    label, predicted = given.label[known], given.predicted[known]
    value = {name: score(given.outputs) for name, score in scores.items()}
    chosen = value[run.card.unknown_score]
    result: dict[str, Any] = {"model": run.card.settings.model, "name": run.name, "classes": list(classes)}
    result |= metrics.summary(label, predicted, classes)
    result |= maneuvers(run, given, chosen)
    result["overtake_against_left"] = metrics.pair_confusion(
        given.outputs.logits[known], label, classes, (int(Intention.LEFT_LANE_CHANGE), int(Intention.OVERTAKE))
    )
    result |= unknown.unknown_metrics(run, given, value)
    result["calibration"] = calibration(given.outputs.logits[known], label, run.card.temperature)
    result["by_lead_time"] = metrics.by_lead_time(
        given.lead_s[known], label, predicted, len(classes), unknown.against_rows(chosen[known], chosen[given.unknown])
    )
    result["by_snr"] = metrics.by_snr(given.snr_db[known], label, predicted, len(classes))
    return result


def maneuvers(run: Run, given: Answers, score: Array) -> dict[str, Any]:
    """Eq. (13) of CaSTFormer: `maneuvers` on windows of known intentions, and `maneuvers_with_background`.

    In the second, windows of `following` are the background, and every window that the run rejects is taken for it;
    score: the run's chosen one, of every window.
    """
    background = len(run.card.classes)
    rows = given.known | given.unknown
    label = np.where(given.known, given.label, background)
    rejected = np.zeros(len(label), dtype=bool)
    if run.card.unknown_threshold is not None:
        rejected = score < run.card.unknown_threshold
    said = np.where(rejected, background, given.predicted)
    known = metrics.confusion(given.label[given.known], given.predicted[given.known], background)
    everything = metrics.confusion(label[rows], said[rows], background + 1)
    return {
        "maneuvers": metrics.maneuver_scores(known),
        "maneuvers_with_background": metrics.maneuver_scores(everything, background),
    }


def swept(run: Run, records: Records, settings: EvaluateSettings, score: open_set.Score) -> dict[str, Any]:
    """`by_window_end`: scores with every window ending at the same time after onset or commit; empty without a sweep.

    Only records that hold a window with that end take part; an end that no record holds is left out. score: the run's
    chosen one.
    """
    if settings.sweep is None:
        return {}
    rows = []
    for end in settings.sweep.ends_s:
        windows = WindowSettings.model_validate(
            {
                **run.card.settings.windows.model_dump(),
                "relative_to": settings.sweep.relative_to,
                "end_after_s": (end, end),
            }
        )
        first, last = end_bounds(records, windows)
        if not (last >= first).any():
            continue
        given = answers(run, records, draw_ends(records, windows, "sweep"))
        found = metrics.summary(given.label[given.known], given.predicted[given.known], run.card.classes)
        value = score(given.outputs)
        rows.append(
            {
                "end_s": end,
                **{name: found[name] for name in ("n", "accuracy", "macro_f1", "per_class_f1")},
                **unknown.entries(value[given.known], value[given.unknown]),
            }
        )
    return {"by_window_end": rows}


def calibration(logits: Array, label: IntArray, temperature: float) -> dict[str, float]:
    """Expected calibration error of the known windows, with and without the temperature chosen in training."""
    plain, cooled = (calibration_error(softmax(logits / t, axis=1), label) for t in (1.0, temperature))
    return {"error": plain, "temperature": temperature, "error_with_temperature": cooled}


def _draw(run: Run, mine: Answers, result: dict[str, Any], side_by_side: list[dict[str, Any]], folder: Path) -> None:
    """The figures of an evaluation; side_by_side: the metrics of one run of every predictor."""
    figures.confusion(np.array(result["confusion"]), run.card.classes, folder / "confusion.png", run.name)
    rows = {each["name"]: each["by_lead_time"] for each in side_by_side}
    figures.lead_time(rows, folder / "lead_time.png")
    if mine.unknown.any():
        figures.unknown_lead_time(rows, folder / "unknown_lead_time.png")
    if "by_window_end" in result:
        ends = {each["name"]: each["by_window_end"] for each in side_by_side}
        relative_to = result["windows"]["sweep"]["relative_to"]
        figures.window_end(ends, relative_to, folder / "window_end.png")
        if mine.unknown.any():
            figures.unknown_window_end(ends, relative_to, folder / "unknown_window_end.png")
    if (run.path / HISTORY_FILE).exists():
        figures.loss_curves(_history(run.path / HISTORY_FILE), folder / "loss.png")
    if mine.unknown.any():
        curves, scores = {}, open_set.of_run(run)
        for name in dict.fromkeys((run.card.unknown_score, open_set.PLAIN)):
            value = scores[name](mine.outputs)
            pick = mine.known | mine.unknown
            false, true, _ = roc_curve(mine.known[pick], value[pick])
            curves[f"{name.replace('_', ' ')} (AUROC {result['unknown_scores'][name]['auroc']:.3f})"] = (false, true)
        figures.unknown_roc(curves, folder / "unknown_roc.png")


def _history(path: Path) -> pd.DataFrame:
    """A run's history of epochs. Raises InputError where it is damaged."""
    try:
        history = pd.read_csv(path, dtype=float).astype({"epoch": int})
        return history[["epoch", "train_loss", "validation_loss", "validation_macro_f1", "validation_accuracy"]]
    except (KeyError, ValueError) as error:
        raise InputError(f"{path}: is damaged ({error}); delete it, and evaluate without it") from None
