"""The tables of docs/predictors.md, from what `python -m isac_cosim.benchmarks.findings.predictors` measured.

    python docs/predictor_tables.py OUT/predictors.json

Prints them in Markdown, those of stages that were run. Values are means over training seeds, with ± their standard
deviation where there are several; intervals in brackets are 95 % intervals over test seeds.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from isac_cosim.evaluation.on_windows.metrics import spread
from isac_cosim.evaluation.on_windows.results import PassScores, PredictorResult
from isac_cosim.evaluation.on_windows.score_results import Difference, ScoreSpreads, Spread, WindowEndScores
from isac_cosim.evaluation.report.parts import markdown
from isac_cosim.labeling.intentions import spoken
from isac_cosim.models import DEFAULT, FLOOR
from isac_cosim.models.predictors.registry import PREDICTORS

Json = dict[str, Any]
SPREADS = frozenset(ScoreSpreads.model_fields)
"""Keys of the scores of a predictor over training seeds."""
HIGHLIGHTED_LEAD_S = 0.5
"""Lead time at which predictors are compared in pairs, s."""


def value(measured: Spread, digits: int = 3) -> str:
    """Return a mean with its standard deviation."""
    if measured.mean is None:
        return ""
    deviation = f" ±{measured.sd:.{digits}f}" if measured.sd is not None else ""
    return f"{measured.mean:.{digits}f}{deviation}"


def difference(interval: Difference | None) -> str:
    """Return a difference with its interval, with signs."""
    if interval is None or interval.difference is None:
        return ""
    bounds = "" if interval.low is None or interval.high is None else f" ({interval.low:+.3f} to {interval.high:+.3f})"
    return f"{interval.difference:+.3f}{bounds}"


def named(model: str) -> str:
    """Return a predictor's name in tables."""
    return PREDICTORS[model].display_name


def by_model(runs: Sequence[Json]) -> dict[str, list[Json]]:
    """Return the runs of each predictor, in their order."""
    grouped: dict[str, list[Json]] = {}
    for run in runs:
        grouped.setdefault(run["model"], []).append(run)
    return grouped


def at_lead(run: Json, lead_s: float) -> Json:
    """Return a run's scores on the windows at one lead time, empty without any."""
    leads: list[Json] = run["before_commit"]["by_lead"]
    return next((scores for scores in leads if scores["lead_s"] == lead_s), {})


def leads(early: Json) -> Iterator[str]:
    """Yield the headline: every predictor by lead time, and differences at one of them."""
    runs = early["runs"]
    measured = runs[0]["before_commit"]["by_lead"]
    times = [scores["lead_s"] for scores in measured]
    highlighted = f"{named(runs[0]['model'])} minus it, {HIGHLIGHTED_LEAD_S:g} s"
    differences = {
        result.name: next(
            (d.macro_f1 for d in result.paired_difference_by_lead or [] if d.lead_s == HIGHLIGHTED_LEAD_S), None
        )
        for result in map(PredictorResult.model_validate, early["predictors"])
    }
    rows = []
    for model, repeats in by_model(runs).items():
        cells = [value(spread([at_lead(run, t).get("macro_f1") for run in repeats])) for t in times]
        rows.append([named(model), *cells, difference(differences.get(named(model)))])
    rows.append(["windows", *(f"{scores['n']:,}" for scores in measured), ""])
    yield "### Before the commit, by lead time"
    yield markdown(["predictor", *(f"{t:g} s" for t in times), highlighted], rows)
    for model in (DEFAULT, FLOOR):
        repeats = by_model(runs).get(model, [])
        if repeats:
            yield f"### {named(model)} before the commit, by intention: F1, recall (windows)"
            intentions = repeats[0]["before_commit"]["per_class"]
            yield markdown(
                ["intention", *(f"{t:g} s" for t in times)],
                [[spoken(name), *(_of_class(repeats, t, name) for t in times)] for name in intentions],
            )


def _of_class(runs: Sequence[Json], lead_s: float, intention: str) -> str:
    per_class = [at_lead(run, lead_s).get("per_class", {}).get(intention) for run in runs]
    known = [scores for scores in per_class if scores is not None and scores["f1"] is not None]
    if not known or not known[0]["n"]:
        return ""
    f1, recall = (spread([scores[key] for scores in known]).mean for key in ("f1", "recall"))
    return f"{f1:.2f}, {recall:.2f} ({known[0]['n']})"


def origins(early: Json) -> Iterator[str]:
    """Yield the scores before the commit by the origin of the maneuvers."""
    runs = early["runs"]
    measured = runs[0]["before_commit"]["by_origin"]
    yield "### Before the commit, by origin"
    yield markdown(
        ["predictor", *measured],
        [
            [
                named(model),
                *(
                    value(spread([run["before_commit"]["by_origin"][o]["macro_f1"] for run in repeats]))
                    for o in measured
                ),
            ]
            for model, repeats in by_model(runs).items()
        ]
        + [["windows", *(f"{scores['n']:,}" for scores in measured.values())]]
        + [["intentions in the mean", *(str(len(scores["macro_f1_over"])) for scores in measured.values())]],
    )


def early_and_late(result: Json) -> Iterator[str]:
    """Yield the scores on all early and all late windows, and how overtake and left change are distinguished."""
    sides = {
        ends: [PredictorResult.model_validate(row) for row in result[ends]["predictors"]] for ends in ("early", "late")
    }
    five = {named(model): runs for model, runs in by_model(result["early"]["runs"]).items()}
    first = sides["early"][0].name
    yield "### Early and late windows"
    yield markdown(
        ["predictor", "macro-F1, early", f"{first} minus it", "macro-F1, late", f"{first} minus it"],
        [
            [
                early.name,
                value(early.macro_f1),
                difference(early.paired_difference.macro_f1 if early.paired_difference else None),
                value(late.macro_f1),
                difference(late.paired_difference.macro_f1 if late.paired_difference else None),
            ]
            for early, late in zip(sides["early"], sides["late"], strict=True)
        ],
    )
    yield "### Overtake against left change"
    yield markdown(
        ["predictor", "five classes, early", "accuracy, early", "AUROC, early", "accuracy, late", "AUROC, late"],
        [
            [
                early.name,
                value(spread([run["five_classes"]["macro_f1"] for run in five[early.name]])),
                *(
                    value(part, 2)
                    for side in (early, late)
                    for part in (side.overtake_against_left.accuracy, side.overtake_against_left.auroc)
                ),
            ]
            for early, late in zip(sides["early"], sides["late"], strict=True)
        ],
    )


def passing(result: Json) -> Iterator[str]:
    """Yield whether the TV passes the UV, as one run of each predictor says."""
    for ends in ("early", "late"):
        first = {runs[0]["name"]: named(model) for model, runs in by_model(result[ends]["runs"]).items()}
        for scores in map(PassScores.model_validate, result[ends].get("passing", [])):
            outcomes = ", ".join(f"{number} {spoken(name)}" for name, number in scores.pull_outs.items())
            yield (
                f"### Passes within {scores.within_s:g} s, {ends}: {scores.n:,} windows of {outcomes}; {scores.groups} "
                f"seeds; base rate {_number(scores.base_rate)}, its Brier score {_number(scores.brier_of_base_rate)}; "
                f"already passed {scores.already_passed}, censored {scores.censored}"
            )
            rows = [
                [first[a.name], _auroc(a.auroc, a.auroc_low, a.auroc_high), "", ""]
                for a in scores.answers
                if a.name in first
            ]
            trained = scores.trained
            if trained is not None:
                area = _auroc(trained.auroc, trained.auroc_low, trained.auroc_high)
                rows.append(["trees trained on it", area, _number(trained.brier), _number(trained.calibration_error)])
            yield markdown(["answer", "AUROC", "Brier score", "calibration error"], rows)


def _number(score: float | None) -> str:
    return "" if score is None else f"{score:.3f}"


def _auroc(area: float | None, low: float | None, high: float | None) -> str:
    if area is None:
        return ""
    return f"{area:.2f}" if low is None or high is None else f"{area:.2f} ({low:.2f} to {high:.2f})"


def window_ends(rows: Sequence[Json]) -> Iterator[str]:
    """Yield the window-end curves."""
    curves = {row["name"]: [WindowEndScores.model_validate(end) for end in row["by_window_end"]] for row in rows}
    yield "### By window end: macro-F1"
    yield markdown(
        ["windows end, s after onset", "windows", *curves],
        [
            [f"{ends[0].end_s:g}", f"{ends[0].n:,}", *("" if s.macro_f1 is None else f"{s.macro_f1:.2f}" for s in ends)]
            for ends in zip(*curves.values(), strict=True)
        ],
    )


def unknown(result: Json) -> Iterator[str]:
    """Yield how well each open-set score separates `following`."""
    columns = [(model, ends) for model in (DEFAULT, FLOOR) for ends in ("early", "late")]
    runs = {(model, ends): by_model(result[ends]["runs"]).get(model, []) for model, ends in columns}
    columns = [column for column in columns if runs[column]]
    names = runs[columns[0]][0]["unknown_scores"]
    yield f"### The unknown: AUROC, share taken for known; {result['early']['runs'][0]['n_unknown']} windows"
    yield markdown(
        ["score", *(f"{named(model)}, {ends}" for model, ends in columns)],
        [[f"`{name}`", *(_separation(runs[column], name) for column in columns)] for name in names],
    )


def _separation(runs: Sequence[Json], name: str) -> str:
    parts = [spread([run["unknown_scores"][name][key] for run in runs]).mean for key in ("auroc", "fpr_at_95_recall")]
    return ", ".join("" if part is None else f"{part:.{digits}f}" for part, digits in zip(parts, (3, 2), strict=True))


def beside(title: str, rows: Sequence[Json]) -> Iterator[str]:
    """Yield accuracy and macro-F1 of predictors in two places."""
    places = list(dict.fromkeys(row["on"] for row in rows))
    yield f"### {title}: " + ", ".join(f"{row['on']} {row['windows']:,}" for row in rows[: len(places)]) + " windows"
    scores = {(row["model"], row["ends"], row["on"]): spreads_of(row) for row in rows}
    keys = dict.fromkeys((row["model"], row["ends"]) for row in rows)
    columns = [(place, name) for place in places for name in ("accuracy", "macro-F1", "before commit")]
    yield markdown(
        ["predictor", "windows", *(f"{name}, {place}" for place, name in columns)],
        [
            [
                named(model),
                ends,
                *(value(part) for place in places for part in _three(scores[model, ends, place])),
            ]
            for model, ends in keys
        ],
    )


def _three(scores: ScoreSpreads) -> tuple[Spread, Spread, Spread]:
    return scores.accuracy, scores.macro_f1, scores.before_commit_macro_f1 or Spread(mean=None, sd=None, n=0)


def spreads_of(row: Json) -> ScoreSpreads:
    """Return the scores in a row that says more."""
    return ScoreSpreads.model_validate({key: content for key, content in row.items() if key in SPREADS})


def samples(rows: Sequence[Json]) -> Iterator[str]:
    """Yield macro-F1 on early windows by the number of training samples."""
    scores = {(row["samples"], row["model"]): spreads_of(row) for row in rows}
    models = dict.fromkeys(row["model"] for row in rows)
    columns = [(model, name) for model in models for name in ("before_commit_macro_f1", "macro_f1")]
    shown = {"before_commit_macro_f1": "before the commit", "macro_f1": "all windows"}
    yield f"### Training samples: macro-F1, {rows[0]['windows']:,} early windows"
    yield markdown(
        ["training samples", *(f"{named(model)}, {shown[name]}" for model, name in columns)],
        [
            [f"{count:,.0f}", *(value(getattr(scores[count, model], name)) for model, name in columns)]
            for count in dict.fromkeys(row["samples"] for row in rows)
        ],
    )


def longer(result: Json) -> Iterator[str]:
    """Yield the longer training of the default predictor, beside the floor."""
    yield "### Longer training"
    for ends, measured in result.items():
        predictors = [PredictorResult.model_validate(row) for row in measured["predictors"]]
        if not predictors:  # with one training seed there are no means
            continue
        yield markdown(
            ["predictor", f"macro-F1, {ends}", f"{predictors[0].name} minus it"],
            [
                [p.name, value(p.macro_f1), difference(p.paired_difference.macro_f1 if p.paired_difference else None)]
                for p in predictors
            ],
        )


def tables(result: Json) -> Iterator[str]:
    """Yield all headings and tables of what the bench has measured so far."""
    if "early" in result:
        yield from leads(result["early"])
        yield from origins(result["early"])
        if result["early"]["predictors"]:  # with one training seed there are no means
            yield from early_and_late(result)
        yield from passing(result)
        yield from unknown(result)
    for key, part in (("by_window_end", window_ends), ("samples", samples), ("longer", longer)):
        if key in result:
            yield from part(result[key])
    for key, title in (("truth", "Sensed against true"), ("other", "On another road")):
        if key in result:
            yield from beside(title, result[key])


def main() -> None:
    """Print the tables of the file that is named."""
    print("\n\n".join(tables(json.loads(Path(sys.argv[1]).read_text()))))


if __name__ == "__main__":
    main()
