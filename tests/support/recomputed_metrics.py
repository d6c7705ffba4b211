"""The figures of metrics.json, recomputed from predictions.parquet by scikit-learn and pandas alone.

Nothing here uses the project's own code: it is what a reader of a published table would write in a notebook.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from scipy.stats import t as student_t
from sklearn.metrics import accuracy_score, confusion_matrix, f1_score, precision_score, recall_score, roc_auc_score

OVERTAKE = "overtake"
LEFT, RIGHT = "left_lane_change", "right_lane_change"
TO_FASTER, TO_SLOWER = "lane_change_to_faster_side", "lane_change_to_slower_side"


def scores(run: pd.DataFrame, content: dict[str, Any], temperature: float) -> dict[str, Any]:
    """What metrics.json says of a run."""
    classes, chosen = content["classes"], run[f"score_{content['unknown_score']}"]
    drawn = run[run["windows"] == "drawn"]
    known, following = drawn[drawn["known"]], drawn[drawn["intention"] == "following"]
    early = known[(known["end_after_onset_s"] > -1e-6) & (known["lead_s"] > 1e-6)]
    late = known[known["lead_s"] <= 1e-6]
    expected = {
        **summary(known, classes),
        "groups": known["group"].nunique(),
        **dict(zip(("macro_f1_low", "macro_f1_high"), interval(known, classes), strict=True)),
        "before_commit": {
            **classified(early, classes),
            "confusion": confusion(early, classes),
            "by_origin": {name: classified(rows, classes) for name, rows in early.groupby("origin")},
            "by_lead": [
                {
                    **classified(rows, classes),
                    "lead_s": lead_s,
                    "by_origin": {name: classified(part, classes) for name, part in rows.groupby("origin")},
                }
                for lead_s, rows in run[(run["windows"] == "at_lead") & run["known"]].groupby("at_s")
            ],
            "onset_to_commit": {name: delay(known[known["intention"] == name]) for name in classes},
        },
        "after_commit": {**classified(late, classes), "confusion": confusion(late, classes)},
        "five_classes": five_classes(known, early, classes),
        "maneuvers": maneuvers(known["intention"], known["predicted"], classes),
        "maneuvers_with_background": with_background(pd.concat([known, following]), classes),
        "overtake_against_left": pair(known),
        "n_unknown": len(following),
        "auroc_unknown": separation(chosen[known.index], chosen[following.index])["auroc"],
        "unknown_scores": all_separations(known, following),
        "calibration": {
            "error": calibration_error(known, classes, 1.0),
            "temperature": temperature,
            "error_with_temperature": calibration_error(known, classes, temperature),
        },
        "by_lead_time": [
            {
                "from_s": from_s,
                "to_s": to_s,
                **binned(rows, classes),
                **of_unknown(separation(chosen[rows.index], chosen[following.index])),
            }
            for from_s, to_s, rows in bins(known, "lead_s", 0.2)
        ],
        "by_snr": [
            {"from_db": low, "to_db": high, **binned(rows, classes)} for low, high, rows in bins(known, "snr_db", 2)
        ],
    }
    if held := sorted({name for name in drawn["intention"] if name != "following"} - set(known["intention"])):
        rows = drawn[drawn["intention"] == held[0]]
        expected["held_out"] = {"intention": held[0], "n": len(rows), "unknown_scores": all_separations(known, rows)}
    if "by_window_end" in content:
        expected["by_window_end"] = [
            point(end_s, rows, classes, content["unknown_score"])
            for end_s, rows in run[run["windows"] == "at_end"].groupby("at_s")
        ]
    return expected


def f1_of(rows: pd.DataFrame, classes: list[str]) -> list[float | None]:
    if not len(rows):
        return [None] * len(classes)
    # Of numbers, because scikit-learn takes long to sort strings.
    label, predicted = (pd.Index(classes).get_indexer(rows[column]) for column in ("intention", "predicted"))
    values = f1_score(label, predicted, labels=range(len(classes)), average=None, zero_division=0)
    return [float(f1) if name in set(rows["intention"]) else None for name, f1 in zip(classes, values, strict=True)]


def macro_f1(rows: pd.DataFrame, classes: list[str]) -> float | None:
    values = [value for value in f1_of(rows, classes) if value is not None]
    return float(np.mean(values)) if values else None


def summary(rows: pd.DataFrame, classes: list[str]) -> dict[str, Any]:
    return {
        "n": len(rows),
        "accuracy": accuracy_score(rows["intention"], rows["predicted"]),
        "macro_f1": macro_f1(rows, classes),
        "macro_f1_over": [name for name in classes if name in set(rows["intention"])],
        "per_class_f1": dict(zip(classes, f1_of(rows, classes), strict=True)),
        "confusion": confusion(rows, classes),
    }


def confusion(rows: pd.DataFrame, classes: list[str]) -> list[list[int]]:
    return pd.crosstab(
        pd.Categorical(rows["intention"], classes), pd.Categorical(rows["predicted"], classes), dropna=False
    ).to_numpy().tolist()  # fmt: skip


def jackknife(values: list[float]) -> float:
    """Half the width of an interval from a score without each group in turn."""
    count = len(values)
    variance = (count - 1) / count * sum((value - np.mean(values)) ** 2 for value in values)
    return float(student_t.ppf(0.975, count - 1) * np.sqrt(variance))


def interval(rows: pd.DataFrame, classes: list[str]) -> tuple[float | None, float | None]:
    groups = sorted(set(rows["group"]))
    value = macro_f1(rows, classes)
    without = [macro_f1(rows[rows["group"] != group], classes) for group in groups]
    if len(groups) < 2 or value is None or None in without:
        return None, None
    half = jackknife([score for score in without if score is not None])
    return max(value - half, 0.0), min(value + half, 1.0)


def classified(rows: pd.DataFrame, classes: list[str]) -> dict[str, Any]:
    n = rows["intention"].value_counts()
    enough = [name for name in classes if n.get(name, 0) >= 5]
    low, high = interval(rows, enough) if enough else (None, None)
    f1 = f1_of(rows, classes)
    recall = rows.assign(hit=rows["intention"] == rows["predicted"]).groupby("intention")["hit"].mean()
    return {
        "n": len(rows),
        "groups": rows["group"].nunique(),
        "accuracy": accuracy_score(rows["intention"], rows["predicted"]) if len(rows) else None,
        "macro_f1": macro_f1(rows, enough) if enough else None,
        "macro_f1_low": low,
        "macro_f1_high": high,
        "macro_f1_over": enough,
        "per_class": {
            name: {"n": int(n.get(name, 0)), "recall": recall.get(name), "f1": f1[k]} for k, name in enumerate(classes)
        },
    }


def delay(rows: pd.DataFrame) -> dict[str, Any]:
    times = (rows["end_after_onset_s"] + rows["lead_s"]).groupby(rows["sample_id"]).first()
    median = float(times.median()) if len(times) else None
    return {"n": len(times), "median_s": median, "at_once": median is not None and median < 0.3}


def sides(rows: pd.DataFrame) -> tuple[str, str]:
    """The lane change to the faster side and the other one."""
    if rows["keeps_left"].nunique() > 1:
        return TO_FASTER, TO_SLOWER
    return (RIGHT, LEFT) if rows["keeps_left"].all() else (LEFT, RIGHT)


def five_classes(known: pd.DataFrame, early: pd.DataFrame, classes: list[str]) -> dict[str, Any]:
    faster, slower = sides(known)
    joint = f"{faster}_or_{OVERTAKE}"
    names = [{LEFT: joint, RIGHT: slower}.get(name, name) for name in classes if name != OVERTAKE]

    def merged(rows: pd.DataFrame) -> pd.DataFrame:
        rows = rows.copy()
        for column in ("intention", "predicted"):
            right_hand = rows[column].replace({LEFT: joint, OVERTAKE: joint, RIGHT: slower})
            left_hand = rows[column].replace({RIGHT: joint, OVERTAKE: joint, LEFT: slower})
            rows[column] = right_hand.mask(rows["keeps_left"], left_hand)
        return rows

    scores = summary(merged(known), names)
    del scores["confusion"]
    before = classified(merged(early), names)
    return {
        "classes": names, **scores, "before_commit_macro_f1": before["macro_f1"],
        "before_commit_macro_f1_over": before["macro_f1_over"],
    }  # fmt: skip


def maneuvers(label: pd.Series, predicted: pd.Series, classes: list[str]) -> dict[str, Any]:
    present = [name for name in classes if name in set(label)]
    precision = precision_score(label, predicted, labels=present, average="macro", zero_division=0)
    recall = recall_score(label, predicted, labels=present, average="macro", zero_division=0)
    return {"precision": precision, "recall": recall, "f1": 2 * precision * recall / (precision + recall)}


def with_background(rows: pd.DataFrame, classes: list[str]) -> dict[str, Any]:
    label = rows["intention"].where(rows["known"], "background")
    return maneuvers(label, rows["predicted"].mask(rows["rejected"], "background"), classes)


def pair(known: pd.DataFrame) -> dict[str, Any]:
    change = np.where(known["keeps_left"], RIGHT, LEFT)
    in_pair = (known["intention"] == OVERTAKE) | (known["intention"] == change)
    logit = known[f"logit_{LEFT}"].mask(known["keeps_left"], known[f"logit_{RIGHT}"])
    margin = (known[f"logit_{OVERTAKE}"] - logit)[in_pair]
    truth = known["intention"][in_pair] == OVERTAKE
    both = truth.any() and not truth.all()
    return {
        "intentions": [sides(known)[0], OVERTAKE],
        "n": len(truth),
        "accuracy": accuracy_score(truth, margin > 0),
        "confusion": confusion_matrix(truth, margin > 0, labels=[False, True]).tolist(),
        "auroc": roc_auc_score(truth, margin) if both else None,
    }


def separation(known: pd.Series, unknown: pd.Series) -> dict[str, float | None]:
    if not len(known) or not len(unknown):
        return {"auroc": None, "fpr_at_95_recall": None}
    truth = [1] * len(known) + [0] * len(unknown)
    return {
        "auroc": roc_auc_score(truth, pd.concat([known, unknown])),
        "fpr_at_95_recall": (unknown >= known.quantile(0.05)).mean(),
    }


def all_separations(known: pd.DataFrame, unknown: pd.DataFrame) -> dict[str, Any]:
    names = [name for name in known.columns if name.startswith("score_")]
    return {name.removeprefix("score_"): separation(known[name], unknown[name]) for name in names}


def calibration_error(rows: pd.DataFrame, classes: list[str], temperature: float) -> float:
    probabilities = np.exp(rows[[f"logit_{name}" for name in classes]].to_numpy() / temperature)
    probabilities /= probabilities.sum(axis=1, keepdims=True)
    if temperature == 1.0:
        np.testing.assert_allclose(rows[[f"p_{name}" for name in classes]], probabilities, atol=1e-12)
    confidence = pd.Series(probabilities.max(axis=1))
    hit = pd.Series((rows["intention"] == rows["predicted"]).to_numpy(), dtype=float)
    bin_number = np.minimum((confidence * 15).astype(int), 14)
    parts = pd.DataFrame({"confidence": confidence, "hit": hit}).groupby(bin_number)
    return float(sum(abs(part["confidence"].mean() - part["hit"].mean()) * len(part) for _, part in parts) / len(rows))


def binned(rows: pd.DataFrame, classes: list[str]) -> dict[str, Any]:
    n = rows["intention"].value_counts()
    enough = [name for name in classes if n.get(name, 0) >= 5]
    return {
        "n": len(rows),
        "accuracy": accuracy_score(rows["intention"], rows["predicted"]),
        "macro_f1": macro_f1(rows, enough) if enough else None,
        "macro_f1_over": enough,
    }


def bins(rows: pd.DataFrame, column: str, width: float) -> list[tuple[float, float, pd.DataFrame]]:
    number = np.floor(rows[column] / width + 1e-6).astype(int)
    return [(k * width, (k + 1) * width, part) for k, part in rows.groupby(number)]


def point(end_s: float, rows: pd.DataFrame, classes: list[str], score: str) -> dict[str, Any]:
    known, following = rows[rows["known"]], rows[rows["intention"] == "following"]
    expected = summary(known, classes)
    del expected["confusion"]
    separated = separation(known[f"score_{score}"], following[f"score_{score}"])
    return {"end_s": end_s, **expected, **of_unknown(separated)}


def of_unknown(separated: dict[str, float | None]) -> dict[str, float | None]:
    """A separation under the keys that it has among other scores."""
    return {"auroc_unknown": separated["auroc"], "fpr_at_95_recall": separated["fpr_at_95_recall"]}


def difference(
    first: list[pd.DataFrame], second: list[pd.DataFrame], classes: list[str], early: bool = False
) -> dict[str, Any]:
    """The paired difference of mean scores of runs."""
    sides = []
    for runs in (first, second):
        kept = [run[(run["windows"] == "drawn") & run["known"]] for run in runs]
        if early:
            kept = [rows[(rows["end_after_onset_s"] > -1e-6) & (rows["lead_s"] > 1e-6)] for rows in kept]
        sides.append(kept)
    return difference_of(sides, classes, 5 if early else 1)


def differences_by_lead(
    first: list[pd.DataFrame], second: list[pd.DataFrame], classes: list[str]
) -> list[dict[str, Any]]:
    """The same at each lead time."""
    leads = sorted(first[0].loc[first[0]["windows"] == "at_lead", "at_s"].unique())
    parts = {lead_s: [[run[(run["windows"] == "at_lead") & (run["at_s"] == lead_s) & run["known"]] for run in runs]
                      for runs in (first, second)] for lead_s in leads}  # fmt: skip
    return [{"lead_s": lead_s, **difference_of(sides, classes, 5)} for lead_s, sides in parts.items()]


def difference_of(sides: list[list[pd.DataFrame]], classes: list[str], least: int) -> dict[str, Any]:
    """The paired difference of mean scores on the same rows, with its intervals, by loops over the seeds."""
    n = sides[0][0]["intention"].value_counts()
    enough = [name for name in classes if n.get(name, 0) >= least]
    groups = sorted(set(sides[0][0]["group"]))

    def gaps(without: str = "") -> dict[str, float]:
        """Differences of mean scores without the windows of a group, NaN where one is undefined."""
        means = []
        for runs in sides:
            scores = []
            for rows in runs:
                f1 = dict(zip(classes, f1_of(rows[rows["group"] != without], classes), strict=True))
                kept = [f1[name] for name in enough if f1[name] is not None]
                scores.append({**f1, "macro": np.mean(kept) if kept else None})
            means.append(pd.DataFrame(scores, dtype=float).mean(skipna=False))
        return dict(means[0] - means[1])

    value, without = gaps(), {group: gaps(group) for group in groups}

    def with_interval(name: str, informed: list[str]) -> dict[str, float | None]:
        left_out = [without[group][name] for group in informed]
        gap = None if np.isnan(value[name]) else value[name]
        if gap is None or len(informed) < 2 or np.isnan(left_out).any():
            return {"difference": gap, "low": None, "high": None}
        half = jackknife(left_out)
        return {"difference": gap, "low": max(gap - half, -1.0), "high": min(gap + half, 1.0)}

    def informed_of(name: str) -> list[str]:
        rows = pd.concat([rows for runs in sides for rows in runs])
        return sorted(set(rows["group"][(rows["intention"] == name) | (rows["predicted"] == name)]))

    return {
        "groups": len(groups),
        "macro_f1": with_interval("macro", groups),
        "macro_f1_over": enough,
        "per_class_f1": {name: with_interval(name, informed_of(name)) for name in classes},
    }


def repeated(name: str, results: list[dict[str, Any]]) -> dict[str, Any]:
    """What is summed up over training seeds."""

    def spread(*keys: str) -> dict[str, Any]:
        values = []
        for result in results:
            value: Any = result
            for key in keys:
                value = value[key]
            values.append(value)
        series = pd.Series(values, dtype=float)
        return {"mean": series.mean(), "sd": series.std() if len(series) > 1 else None, "n": len(series)}

    return {
        "name": name,
        "training_seeds": [0, 1][: len(results)],
        "accuracy": spread("accuracy"),
        "macro_f1": spread("macro_f1"),
        "before_commit_macro_f1": spread("before_commit", "macro_f1"),
        "auroc_unknown": spread("auroc_unknown"),
        "per_class_f1": {key: spread("per_class_f1", key) for key in results[0]["classes"]},
        "overtake_against_left": {key: spread("overtake_against_left", key) for key in ("accuracy", "auroc")},
    }
