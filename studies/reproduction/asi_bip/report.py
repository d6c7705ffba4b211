"""The page of the ASI-BIP reproduction: its tables, figures and claims, from the files of the stages."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from isac_cosim.base.arrays import Array
from isac_cosim.evaluation.on_windows.metrics import accuracy, class_f1, mean_f1
from isac_cosim.evaluation.report import figures
from isac_cosim.evaluation.report.html.charts import Chart
from isac_cosim.evaluation.report.parts import Part, Row, write_table
from isac_cosim.evaluation.statistics import (
    Trainings,
    between_0_and_1,
    class_mean,
    difference,
    estimate,
    of_left_out,
    over_trainings,
    pooled,
    score,
)
from isac_cosim.labeling.intentions import KNOWN, spoken
from isac_cosim.models.scores import open_set
from isac_cosim.studies.reproduction.asi_bip.claims import asi_bip_claims
from isac_cosim.studies.reproduction.asi_bip.results import DatasetResult, TrainingsResult
from isac_cosim.studies.reproduction.asi_bip.stages import FAST
from isac_cosim.studies.reproduction.experiments import drawings
from isac_cosim.studies.reproduction.experiments.counterparts import ASI_BIP, counterparts_part
from isac_cosim.studies.reproduction.experiments.pages import FIGURES, TABLES, claims_part
from isac_cosim.studies.reproduction.experiments.paper_figures import CASES, CLASS_F1, UNKNOWN_AUROC
from isac_cosim.studies.reproduction.experiments.sensing_cases import TRAINED, weather_cases, weather_stage
from isac_cosim.studies.reproduction.experiments.sizes import AsiBipSize
from isac_cosim.studies.reproduction.experiments.stages import result_of
from isac_cosim.studies.reproduction.experiments.trainings import Scores, of_measure
from isac_cosim.studies.reproduction.experiments.unknown_class import RATES, UnknownScores
from isac_cosim.studies.reproduction.experiments.verdicts import Claim

FUSIONS = {
    "aligned": "aligned: one LSTM over both streams at 100 Hz",
    "control-slow": "ASI-BIP, the TV resampled to 100 Hz",
    "control-fast": "ASI-BIP, the UV interpolated to 400 Hz",
}
"""Networks that fuse both streams at one rate, by the stage's name."""
CLASSES = [intention.text for intention in KNOWN]


def asi_bip_parts(out: Path, size: AsiBipSize) -> tuple[list[Part], list[Claim]]:
    """Return the parts of the page for the stages that were run, their figures drawn, and the claims."""
    (out / FIGURES).mkdir(exist_ok=True)
    (out / TABLES).mkdir(exist_ok=True)
    cases, by_snr = case_counts(out, size), snr_counts(out)
    claims = asi_bip_claims(cases, by_snr, _unknown_scores(out))
    parts = [
        claims_part(claims),
        _data(out),
        _table_1(out, size, cases),
        _training(out),
        _unknown(out),
        _snr(out, by_snr),
        _fusion(out, cases),
        _literal(out),
        _fast(out, cases),
    ]
    shown = [part for part in parts if part is not None]
    return [*shown, counterparts_part(ASI_BIP, shown)], claims


def case_counts(out: Path, size: AsiBipSize) -> dict[str, Trainings]:
    """Return the confusion matrices of every way of sensing that was run, and of aligned fusion."""
    counts: dict[str, Trainings] = {}
    for name in [*(case.name for case in TRAINED), *FUSIONS]:
        counts[name] = of_measure(_scores(out, name), "test")
    for chain in size.weather_chains:
        scores = _scores(out, weather_stage(chain))
        for case in weather_cases(chain):
            counts[case.name] = of_measure(scores, case.name)
    # In the worst weather the sites may lose every vehicle.
    return {name: trainings for name, trainings in counts.items() if trainings and all(trainings)}


def snr_counts(out: Path) -> dict[float, Trainings]:
    """Return the confusion matrices at each test SNR, dB, at which the sites followed any vehicle."""
    result = result_of(out, "fig5", TrainingsResult)
    if result is None:
        return {}
    by_snr = {snr_db: of_measure(result.trainings, f"{snr_db:g}") for snr_db in result.snr_db}
    return {snr_db: counts for snr_db, counts in by_snr.items() if counts and all(counts)}


def _data(out: Path) -> Part | None:
    result = result_of(out, "data", DatasetResult)
    if result is None:
        return None
    rows: list[Row] = [
        {"side": side, "scenario seeds": len(result.sides[side]), **counts} for side, counts in result.samples.items()
    ]
    text = "The paper has 6,000 samples, 80 % of which train, and 1,200 to test. Ours are split by scenario seed."
    return Part("data", "Samples", text, rows)


def _table_1(out: Path, size: AsiBipSize, cases: dict[str, Trainings]) -> Part | None:
    rows: list[Row] = []
    drawn: dict[str, tuple[float, float, float]] = {}
    paper: dict[str, float] = {}
    stages = [(case.name, case) for case in TRAINED]
    stages += [(weather_stage(chain), case) for chain in size.weather_chains for case in weather_cases(chain)]
    for stage, case in stages:
        if case.name not in cases:
            continue
        counts = cases[case.name]
        f1 = class_mean(mean_f1, counts)
        reference = CASES.get(case.paper_case) if case.paper_case else None
        rows.append(
            {
                "case": case.title,
                "paper's case": case.paper_case,
                "paper: accuracy": reference and reference[0],
                "ours: accuracy": score(accuracy, counts),
                "paper: macro-F1": reference and reference[1],
                "ours: macro-F1": f1,
                "windows": int(pooled(counts).sum()) // len(counts),
                "trainings": len(counts),
                "position error, m": _position_error(out, stage, case.name),
            }
        )
        if f1.value is not None:
            low, high = (f1.value if bound is None else bound for bound in (f1.low, f1.high))
            drawn[case.title] = (f1.value, low, high)
            if reference:
                paper[case.title] = reference[1]
    if not rows:
        return None
    drawings.bars(drawn, paper, out / FIGURES / "table1.png")
    text = (
        "Each case is trained and tested on what it senses, but for ISAC in adverse weather, which is tested with the "
        "predictors trained in clear weather: once in violent rain, once with the loss that the paper gives the radar. "
        "The paper's Case 2 is in adverse weather, so it stands beside all rows of ISAC. "
        "The paper gives no ranges for its motion, so compare the order of the cases and their gaps, not single "
        "numbers. A sensor may lose a record; `windows` says how many it followed."
    )
    return Part("table1", "Table I: ways of sensing", text, rows, [("table1.png", "Macro-F1 by way of sensing.")])


def _position_error(out: Path, stage: str, case: str) -> float | None:
    """Return the median distance of a case's filtered positions from the true ones, m."""
    result = result_of(out, stage, TrainingsResult)
    dataset = None if result is None else result.datasets.get(case, result.dataset)
    return None if dataset is None else dataset.median_position_error_m


def _training(out: Path) -> Part | None:
    scores = _scores(out, "fig3")
    if not scores:
        return None
    folder, drawn = out / FIGURES, []
    if scores[0].history:
        figures.loss_curves(pd.DataFrame(scores[0].history).astype({"epoch": int}), folder / "fig3_loss.png")
        history = [
            {"training seed": training.training_seed, **epoch, "epoch": int(epoch["epoch"]) + 1}
            for training in scores
            for epoch in training.history or ()
        ]
        write_table(history, out / TABLES / "fig3_loss.csv")
        drawn.append(("fig3_loss.png", f"Training and validation, training seed {scores[0].training_seed}."))
    counts = of_measure(scores, "test")
    figures.confusion(np.array(pooled(counts).tolist()), CLASSES, folder / "fig3_confusion.png", "ASI-BIP")
    write_table(_matrix(pooled(counts).tolist(), CLASSES), out / TABLES / "fig3_confusion.csv")
    drawn.append(("fig3_confusion.png", "Confusion on the test seeds, all trainings together."))
    rows: list[Row] = []
    for number, name in enumerate(CLASSES):
        validation = of_measure(scores, "validation")
        rows.append(
            {
                "intention": spoken(name),
                "paper: F1": CLASS_F1.get(name),
                "ours: F1, test": score(class_f1(number), counts),
                "ours: F1, validation": score(class_f1(number), validation),
            }
        )
    text = "ASI-BIP on what the sites sense at 0 to 10 dB. The paper prints three of the six F1."
    return Part("fig3", "Fig. 3: feasibility", text, rows, drawn)


def _unknown_scores(out: Path) -> list[UnknownScores]:
    return [training.unknown for training in _scores(out, "fig4") if training.unknown is not None]


def _unknown(out: Path) -> Part | None:
    measured = _unknown_scores(out)
    if not measured:
        return None
    folder, first = out / FIGURES, measured[0]
    grid = np.linspace(0, 1, RATES)
    curves = {name: (grid, _mean([scores.roc[name] for scores in measured])) for name in first.roc}
    figures.unknown_roc(curves, folder / "fig4_roc.png")
    by_intention = {
        name: (grid, _mean([scores.roc_by_intention[name] for scores in measured]))
        for name in first.roc_by_intention
        if all(name in scores.roc_by_intention for scores in measured)
    }
    if by_intention:
        figures.unknown_roc(
            {spoken(name): curve for name, curve in by_intention.items()}, folder / "fig4_roc_by_intention.png"
        )
    known, unknown = (_total(measured, name) for name in ("known_confidence", "unknown_confidence"))
    drawings.confidence(known, unknown, first.threshold, folder / "fig4_confidence.png")
    counts = np.sum([scores.confusion for scores in measured], axis=0).tolist()
    figures.confusion(np.array(counts), [*CLASSES, "unknown"], folder / "fig4_confusion.png", "ASI-BIP, thresholded")
    points = [
        {"false-positive rate": float(grid[k])} | {n: float(c[1][k]) for n, c in curves.items()} for k in range(RATES)
    ]
    write_table(points, out / TABLES / "fig4_roc.csv")
    bins = [{"confidence from": k / len(known), "known": n, "following": unknown[k]} for k, n in enumerate(known)]
    write_table(bins, out / TABLES / "fig4_confidence.csv")
    write_table(_matrix(counts, [*CLASSES, "unknown"]), out / TABLES / "fig4_confusion.csv")
    rows: list[Row] = []
    for name in first.auroc:
        areas = np.array([scores.auroc[name] for scores in measured])
        left_out = np.array([scores.auroc_without.get(name, []) for scores in measured])
        rows.append(
            {
                "score": name,
                "paper: AUROC": UNKNOWN_AUROC if name == "msp" else None,
                "ours: AUROC": between_0_and_1(of_left_out(areas, left_out)),
                "saw driving in training": "yes" if name == open_set.PRE_ONSET_DETECTOR else "no",
            }
        )
    text = (
        "`following` takes no part in training. The paper does not name its score; the largest probability (msp) is "
        "the common one. The paper could not have used `pre_onset`, which was trained on windows before the onset. "
        f"{first.n_known} known windows and {first.n_unknown} of following in each training. At the threshold, which "
        f"95 % of the known validation windows pass, {_share_identified(counts):.0%} of following is identified."
    )
    drawn = [
        ("fig4_roc.png", "ROC, mean over the trainings."),
        ("fig4_confidence.png", "Confidence; the threshold is that of the first training."),
        ("fig4_confusion.png", "Confusion where windows below the threshold count as unknown."),
    ]
    if by_intention:
        drawn.insert(1, ("fig4_roc_by_intention.png", "ROC of each intention against `following`, by msp."))
    rows += [
        {
            "score": f"msp, {spoken(name)} alone",
            "ours: AUROC": between_0_and_1(
                over_trainings(np.array([scores.auroc_by_intention[name] for scores in measured]))
            ),
            "saw driving in training": "no",
        }
        for name in by_intention
    ]
    return Part("fig4", "Fig. 4: the unknown class", text, rows, drawn)


def _snr(out: Path, by_snr: dict[float, Trainings]) -> Part | None:
    if not by_snr:
        return None
    levels = sorted(by_snr)
    rows: list[Row] = [
        {
            "SNR, dB": level,
            "windows": int(pooled(by_snr[level]).sum()) // len(by_snr[level]),
            "macro-F1": class_mean(mean_f1, by_snr[level]),
            **{spoken(name): score(class_f1(k), by_snr[level]) for k, name in enumerate(CLASSES)},
        }
        for level in levels
    ]
    curves = {
        spoken(name): [_value(score(class_f1(k), by_snr[level]).value) for level in levels]
        for k, name in enumerate(CLASSES)
    }
    labels = ("F1 by SNR, trained at 0 to 10 dB", "per-element SNR, dB", "F1")
    drawings.lines(curves, levels, out / FIGURES / "fig5.png", labels)
    text = (
        "The predictors of Table I (ISAC, our estimator), tested on the same motion sensed at other SNRs; nothing is "
        "trained anew. The paper prints no numbers for this figure. Records that the sites lose at a low SNR are left "
        "out."
    )
    chart = Chart("SNR, dB", ("F1",), "intention", x_title="per-element SNR, dB")
    drawn: list[Row] = [
        {"intention": name, "SNR, dB": level, "F1": value}
        for name, values in curves.items()
        for level, value in zip(levels, values, strict=True)
    ]
    pictures = [("fig5.png", "F1 of each intention.")]
    return Part(
        "fig5", "Fig. 5: F1 by SNR", text, rows, pictures, figure_rows={"fig5.png": drawn}, charts={"fig5.png": chart}
    )


def _fusion(out: Path, cases: dict[str, Trainings]) -> Part | None:
    if "isac" not in cases or not FUSIONS.keys() & cases.keys():
        return None
    rows: list[Row] = [
        {
            "fusion": title,
            "macro-F1": class_mean(mean_f1, cases[name]),
            "macro-F1 of asynchronous fusion minus this": None
            if name == "isac"
            else estimate(difference(mean_f1), cases["isac"], cases[name]),
            "parameters": _scores(out, name)[0].parameters,
        }
        for name, title in {"isac": "asynchronous: ASI-BIP, each stream at its rate", **FUSIONS}.items()
        if name in cases
    ]
    text = (
        "`aligned` differs from ASI-BIP in more than the rate: it has one LSTM, no attention and a tenth of the "
        "parameters. The controls are ASI-BIP itself, with as many parameters and tokens, on streams of one rate: they "
        "alone say what the asynchronous fusion is worth."
    )
    return Part("fusion", "Asynchronous or aligned fusion", text, rows)


def _literal(out: Path) -> Part | None:
    scores = _scores(out, "literal")
    if not scores:
        return None
    rows: list[Row] = [
        {
            "tokens": training.name,
            "accuracy": score(accuracy, of_measure([training], "test")),
            "macro-F1": class_mean(mean_f1, of_measure([training], "test")),
            "parameters": training.parameters,
            "processor time of the training, s": training.cpu_s,
        }
        for training in scores
    ]
    result = result_of(out, "literal", TrainingsResult)
    assert result is not None
    length = "1 epoch" if result.epochs == 1 else f"{result.epochs} epochs"
    text = (
        "Literal: every LSTM output is a token, 1,101 with the class token, as the paper's figure shows it. Pooled: 89 "
        f"tokens, as in all other tables. One training each, of {length}."
    )
    return Part("literal", "The architecture taken literally", text, rows)


def _fast(out: Path, cases: dict[str, Trainings]) -> Part | None:
    scores = _scores(out, "fast")
    if not scores:
        return None
    rows: list[Row] = []
    for name in FAST:
        counts = of_measure([training for training in scores if training.name.startswith(f"fast-{name},")], "test")
        plain = cases.get("isac")
        rows.append(
            {
                "training": name,
                "accuracy": score(accuracy, counts),
                "macro-F1": class_mean(mean_f1, counts),
                "macro-F1 minus that of ISAC": estimate(difference(mean_f1), counts, plain) if plain else None,
            }
        )
    text = (
        "Two ways to train faster, neither of which is in the paper: the LSTMs in bfloat16, and 25 ms of samples side "
        "by side in one step of an LSTM. Both are compared with ISAC of Table I, on the same test and training seeds. "
        "`cosim bench train` times their steps."
    )
    return Part("fast", "Faster trainings", text, rows)


def _share_identified(counts: Sequence[Sequence[int]]) -> float:
    """Return the share of `following` that is identified; counts: with the unknown class last."""
    return counts[-1][-1] / max(1, sum(counts[-1]))


def _scores(out: Path, stage: str) -> list[Scores]:
    """Return the scores of a stage, none where it was not run."""
    result = result_of(out, stage, TrainingsResult)
    return [] if result is None else result.trainings


def _mean(values: Sequence[Sequence[float]]) -> Array:
    return np.asarray(np.mean(values, axis=0))


def _total(measured: Sequence[UnknownScores], name: str) -> Array:
    return np.asarray(np.sum([getattr(scores, name) for scores in measured], axis=0), dtype=np.float64)


def _matrix(counts: Sequence[Sequence[int]], names: Sequence[str]) -> list[Row]:
    """Return a confusion matrix as rows, true intentions down and predicted ones across."""
    return [{"true": name, **dict(zip(names, row, strict=True))} for name, row in zip(names, counts, strict=True)]


def _value(number: float | None) -> float:
    return float("nan") if number is None else number
