"""A run on the windows of a dataset: metrics.json and the figures."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import numpy.typing as npt
import pandas as pd
from pydantic import Field
from scipy.special import softmax
from sklearn.metrics import roc_curve

from isacsim.errors import InputError
from isacsim.settings import Settings
from labeling.intentions import KNOWN, Intention
from models import figures, metrics, openset
from models.calibration import calibration_error
from models.run import HISTORY_FILE, Outputs, Run, replace, versions
from models.windows import Array, Ends, Ints, Records, WindowSettings, batches, draw_ends, end_bounds

if TYPE_CHECKING:
    from labeling.dataset import Dataset

METRICS_FILE = "metrics.json"
BATCH = 64


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


@dataclass(frozen=True)
class Answers:
    """What a run said about the windows of records no choice was made on.

    known, unknown: rows of `outputs` that belong to a known intention and to `following`.
    """

    outputs: Outputs
    label: Ints
    group: npt.NDArray[np.object_]
    lead_s: Array
    snr_db: Array

    @property
    def known(self) -> npt.NDArray[np.bool_]:
        return np.asarray(np.isin(self.label, KNOWN))

    @property
    def unknown(self) -> npt.NDArray[np.bool_]:
        return np.asarray(self.label == Intention.FOLLOWING)

    @property
    def predicted(self) -> Ints:
        return np.asarray(self.outputs.logits.argmax(axis=1), dtype=np.int64)


def evaluate(
    run: Run, dataset: Dataset, out: str | Path, settings: EvaluateSettings | None = None, against: Sequence[Run] = ()
) -> dict[str, Any]:
    """Measure a run on the seeds of a dataset that it was not trained or chosen on; writes metrics.json and figures.

    against: other runs on the same windows, e.g. floors, each with its paired difference. Returns the metrics.
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
    folder = Path(out)
    claim(folder, METRICS_FILE)
    records = unseen(records, [run, *against])
    windows = run.card.settings.windows
    if settings.end_after_s is not None:
        windows = WindowSettings.model_validate({**windows.model_dump(), "end_after_s": settings.end_after_s})
    ends = draw_ends(records, windows, "evaluate", settings.seed, per_record=settings.ends_per_record)
    mine = answers(run, records, ends)
    result = measure(run, mine) | swept(run, records, settings)
    result["compared"] = []
    for other in against:
        theirs = answers(other, records, ends)
        difference = metrics.paired_difference(
            mine.label[mine.known],
            mine.predicted[mine.known],
            theirs.predicted[mine.known],
            mine.group[mine.known],
            run.card.classes,
        )
        result["compared"].append(
            {**measure(other, theirs), **swept(other, records, settings), "paired_difference": difference}
        )
    result["windows"] = {**windows.model_dump(mode="json"), **settings.model_dump(mode="json", exclude={"end_after_s"})}
    result["made_by"] = {
        "dataset": made_of,
        "seeds": sorted(set(records.groups)),
        "runs": [each.card.model_dump(mode="json") for each in (run, *against)],
        "versions": versions(),
    }
    replace(folder / METRICS_FILE, lambda path: path.write_text(json.dumps(result, indent=1) + "\n"))
    _draw(run, mine, result, folder)
    return result


def answers(run: Run, records: Records, ends: Ends) -> Answers:
    """The run's outputs on those windows."""
    if (records.tv_rate_hz, records.uv_rate_hz) != (run.card.tv_rate_hz, run.card.uv_rate_hz):
        raise InputError(
            f"{run.path}: trained on {run.card.tv_rate_hz:g} and {run.card.uv_rate_hz:g} Hz, the dataset has "
            f"{records.tv_rate_hz:g} and {records.uv_rate_hz:g} Hz; train on a dataset of the same rates"
        )
    parts = [run.predictor(w) for w in batches(records, ends, run.card.settings.windows, BATCH)]
    outputs = Outputs(np.concatenate([p.logits for p in parts]), np.concatenate([p.features for p in parts]))
    table = records.table.iloc[ends.row]
    lead = table["t_commit"].to_numpy(dtype=np.float64) - ends.times(records)
    return Answers(
        outputs, records.label[ends.row], records.groups[ends.row], lead, table["snr_db"].to_numpy(dtype=np.float64)
    )


def measure(run: Run, given: Answers) -> dict[str, Any]:
    """The metrics of one run's answers, by the contract's names."""
    classes, known = run.card.classes, given.known
    label, predicted = given.label[known], given.predicted[known]
    result: dict[str, Any] = {"model": run.card.settings.model, "name": run.name, "classes": list(classes)}
    result |= metrics.summary(label, predicted, classes)
    result |= maneuvers(run, given)
    result |= unknown_metrics(run, given)
    result["calibration"] = calibration(given.outputs.logits[known], label, run.card.temperature)
    result["by_lead_time"] = metrics.by_lead_time(given.lead_s[known], label, predicted, len(classes))
    result["by_snr"] = metrics.by_snr(given.snr_db[known], label, predicted, len(classes))
    return result


def maneuvers(run: Run, given: Answers) -> dict[str, Any]:
    """Eq. (13) of CaSTFormer: `maneuvers` on windows of known intentions, and `maneuvers_with_background`.

    In the second, windows of `following` are the background, and every window that the run rejects is taken for it.
    """
    background = len(run.card.classes)
    rows = given.known | given.unknown
    label = np.where(given.known, given.label, background)
    rejected = np.zeros(len(label), dtype=bool)
    if run.card.unknown_threshold is not None:
        rejected = openset.of_run(run, run.card.unknown_score)(given.outputs) < run.card.unknown_threshold
    said = np.where(rejected, background, given.predicted)
    known = metrics.confusion(given.label[given.known], given.predicted[given.known], background)
    everything = metrics.confusion(label[rows], said[rows], background + 1)
    return {
        "maneuvers": metrics.maneuver_scores(known),
        "maneuvers_with_background": metrics.maneuver_scores(everything, background),
    }


def swept(run: Run, records: Records, settings: EvaluateSettings) -> dict[str, Any]:
    """`by_window_end`: scores with every window ending at the same time after onset or commit; empty without a sweep.

    Only records that hold a window with that end take part; an end that no record holds is left out.
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
        score = openset.of_run(run, run.card.unknown_score)(given.outputs)
        rows.append(
            {
                "end_s": end,
                **{name: found[name] for name in ("n", "accuracy", "macro_f1", "per_class_f1")},
                "auroc_unknown": openset.auroc(score[given.known], score[given.unknown]),
            }
        )
    return {"by_window_end": rows}


def unknown_metrics(run: Run, given: Answers) -> dict[str, Any]:
    """AUROC and false-positive rate at 95 % recall of every score; `auroc_unknown` is of the run's chosen score."""
    each = {}
    for name, score in openset.scores(run.reference).items():
        value = score(given.outputs)
        known, unknown = value[given.known], value[given.unknown]
        each[name] = {
            "auroc": openset.auroc(known, unknown),
            "fpr_at_95_recall": openset.accepted_unknown(known, unknown),
        }
    return {
        "n_unknown": int(given.unknown.sum()),
        "auroc_unknown": each[run.card.unknown_score]["auroc"],
        "unknown_score": run.card.unknown_score,
        "unknown_scores": each,
    }


def calibration(logits: Array, label: Ints, temperature: float) -> dict[str, float]:
    """Expected calibration error of the known windows, with and without the temperature chosen in training."""
    plain, cooled = (calibration_error(softmax(logits / t, axis=1), label) for t in (1.0, temperature))
    return {"error": plain, "temperature": temperature, "error_with_temperature": cooled}


def unseen(records: Records, runs: Sequence[Run]) -> Records:
    """The records of scenario seeds that none of the runs was trained or chosen on.

    Seeds that a run with a smaller training share left unused are no test seeds either: runs of all shares are measured
    on the same ones.
    """
    seen = {group for run in runs for side, groups in run.card.split.items() if side != "test" for group in groups}
    left = ~np.isin(records.groups, list(seen))
    if not (left & np.isin(records.label, KNOWN)).any():
        raise InputError("every scenario seed of the dataset was used in training: evaluate on other seeds")
    return records.take(left)


def claim(folder: Path, mark: str) -> None:
    """Make a folder of results. InputError where it exists and holds no file of that name, i.e. something else."""
    if folder.exists() and (not folder.is_dir() or (any(folder.iterdir()) and not (folder / mark).exists())):
        raise InputError(f"{folder}: exists and holds no {mark}; choose a new folder")
    folder.mkdir(parents=True, exist_ok=True)


def _draw(run: Run, mine: Answers, result: dict[str, Any], folder: Path) -> None:
    """The figures of an evaluation."""
    figures.confusion(np.array(result["confusion"]), run.card.classes, folder / "confusion.png", run.name)
    rows = {result["name"]: result["by_lead_time"]} | {
        each["name"]: each["by_lead_time"] for each in result["compared"]
    }
    figures.lead_time(rows, folder / "lead_time.png")
    if "by_window_end" in result:
        ends = {each["name"]: each["by_window_end"] for each in (result, *result["compared"])}
        figures.window_end(ends, result["windows"]["sweep"]["relative_to"], folder / "window_end.png")
    if (run.path / HISTORY_FILE).exists():
        figures.loss_curves(pd.read_csv(run.path / HISTORY_FILE), folder / "loss.png")
    if mine.unknown.any():
        curves = {}
        for name in dict.fromkeys((run.card.unknown_score, openset.PLAIN)):
            value = openset.of_run(run, name)(mine.outputs)
            pick = mine.known | mine.unknown
            false, true, _ = roc_curve(mine.known[pick], value[pick])
            curves[f"{name.replace('_', ' ')} (AUROC {result['unknown_scores'][name]['auroc']:.3f})"] = (false, true)
        figures.unknown_roc(curves, folder / "unknown_roc.png")
