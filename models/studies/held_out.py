"""The second protocol of the unknown: every known intention in turn is left out of training and unknown at test.

OUT/<intention>/               the run trained without it
OUT/<intention>/evaluation/    its evaluation
OUT/held_out.json              the table, by intention and score
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rich.table import Table

from isacsim.feedback import SILENT, Feedback
from isacsim.files import claim, write_json
from isacsim.versions import OF_RUNS, versions
from labeling.intentions import KNOWN
from models.data.windows import Records
from models.evaluation.evaluation import EvaluateSettings, evaluate_records
from models.evaluation.metrics import spread
from models.report.figures import spoken
from models.settings import TrainSettings
from models.training.training import train_records

TABLE_FILE = "held_out.json"


def hold_out_each(
    records: Records,
    made_of: dict[str, Any],
    out: str | Path,
    settings: TrainSettings,
    evaluation: EvaluateSettings | None = None,
    feedback: Feedback = SILENT,
) -> dict[str, Any]:
    """Train without each known intention of the records in turn, and tell its windows of the test seeds apart.

    made_of: what the runs' cards say of the dataset, `digest` among it. The same call again goes on where it stopped.
    Returns what held_out.json holds: `held_out` has, by intention, `n` of its windows and `n_known` of the others,
    their `macro_f1`, and of every score the AUROC and the false-positive rate at 95 % recall; `mean` is over the
    intentions. `unknown_score` is the one chosen on the validation seeds' `following`, which the intention is not part
    of. InputError where `out` holds something else.
    """
    with claim(Path(out), TABLE_FILE, "held-out study"):
        return _hold_out_each(records, made_of, Path(out), settings, evaluation or EvaluateSettings(), feedback)


def _hold_out_each(
    records: Records,
    made_of: dict[str, Any],
    folder: Path,
    settings: TrainSettings,
    evaluation: EvaluateSettings,
    feedback: Feedback,
) -> dict[str, Any]:
    """Train and evaluate in a folder that is held."""
    result: dict[str, Any] = {"model": settings.model, "held_out": {}, "mean": {}}
    _write(result, folder)
    for intention in (i for i in KNOWN if (records.label == i).any()):
        name = intention.text
        without = TrainSettings.model_validate({**settings.model_dump(), "held_out": name})
        run = train_records(records, made_of, folder / name, without, feedback)
        found = evaluate_records(run, records, made_of, folder / name / "evaluation", evaluation)
        told = found["held_out"]
        result["held_out"][name] = {
            "n": told["n"],
            "n_known": found["n"],
            "macro_f1": found["macro_f1"],
            "unknown_score": found["unknown_score"],
            "unknown_scores": told["unknown_scores"],
        }
        result["made_by"] = {
            "dataset": made_of,
            "training": settings.model_dump(mode="json"),
            "windows": found["windows"],
            "seeds": found["made_by"]["seeds"],
            "versions": versions(OF_RUNS),
        }
    result["mean"] = _means([row["unknown_scores"] for row in result["held_out"].values()])
    _write(result, folder)
    return result


def table(found: dict[str, Any]) -> Table:
    """AUROC and false-positive rate at 95 % recall by intention and score; the chosen score of each is marked."""
    names = list(found["mean"])
    drawn = Table(title="held out: AUROC / share taken for known", title_justify="left")
    drawn.add_column("intention")
    for name in names:
        drawn.add_column(spoken(name), justify="right")
    for intention, row in found["held_out"].items():
        cells = [_cell(row["unknown_scores"].get(name), name == row["unknown_score"]) for name in names]
        drawn.add_row(spoken(intention), *cells)
    drawn.add_section()
    drawn.add_row("mean", *(_cell(found["mean"][name], chosen=False) for name in names))
    return drawn


def _means(rows: list[dict[str, dict[str, float | None]]]) -> dict[str, dict[str, float | None]]:
    """Means over intentions, of the scores that all of them have."""
    shared = [name for name in rows[0] if all(name in row for row in rows)]
    return {
        name: {key: spread([row[name][key] for row in rows])["mean"] for key in ("auroc", "fpr_at_95_recall")}
        for name in shared
    }


def _cell(each: dict[str, float | None] | None, chosen: bool) -> str:
    if each is None or each["auroc"] is None or each["fpr_at_95_recall"] is None:
        return "-"
    return f"{each['auroc']:.3f} / {each['fpr_at_95_recall']:.2f}{' *' if chosen else ''}"


def _write(result: dict[str, Any], folder: Path) -> None:
    write_json(folder / TABLE_FILE, result)
