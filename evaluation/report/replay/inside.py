"""What the modules of a CaSTFormer do along a record, for the replay."""

from __future__ import annotations

from isac_cosim.base.arrays import Array
from isac_cosim.evaluation.on_windows.explained import inspect_windows, is_explainable, mean_age_s
from isac_cosim.evaluation.report.replay.content import Inside
from isac_cosim.models.data.windows import Ends, Records
from isac_cosim.models.networks.castformer_inspection import BRANCHES, STREAMS
from isac_cosim.models.predictors.castformer import CastformerSettings
from isac_cosim.models.runs.run import Run

REMARK = (
    "Below the probabilities, of the window that ends at each time: mean age of the frames that RSF attends to, gates "
    "of CPE, length of its gated residuals over that of the stream, and weights of the branches of FSN (in: the stream "
    "of the TV, out: of the UV). What a module attends to is no proof of what causes the answer."
)


def inside_of(run: Run, records: Records, ends: Ends) -> list[Inside]:
    """Return what each module does with windows of a record; nothing of other predictors."""
    if not is_explainable(run):
        return []
    seen, frame_s = inspect_windows(run, records, ends), run.card.settings.of(CastformerSettings).frame_s
    age: Array | None = None if seen.attention is None else mean_age_s(seen.attention, frame_s)
    modules = (
        ("RSF: age attended to, s", STREAMS, age),
        ("CPE: gate", STREAMS, seen.gate),
        ("CPE: residual over stream", STREAMS, seen.residual),
        ("FSN: weight", BRANCHES, seen.weight),
    )
    return [Inside(title, names, values.T) for title, names, values in modules if values is not None]
