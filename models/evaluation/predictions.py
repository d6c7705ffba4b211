"""What a run says about windows that no choice was made on, with what is known of each window."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from isacsim.arrays import Array, IntArray
from isacsim.errors import InputError
from labeling.intentions import KNOWN, Intention
from models.data.windows import Ends, Records, batches
from models.predictors.protocol import Outputs
from models.run import Run

BATCH = 64


@dataclass(frozen=True)
class Answers:
    """A run's outputs on n windows.

    label, group, lead_s, snr_db: of each window, (n,); the lead time is commit minus window end. left_out: the
    intention that the run was trained without, if any.
    """

    outputs: Outputs
    label: IntArray
    group: npt.NDArray[np.object_]
    lead_s: Array
    snr_db: Array
    left_out: Intention | None = None

    @property
    def known(self) -> npt.NDArray[np.bool_]:
        """Rows of an intention that the run was trained on."""
        return np.asarray(np.isin(self.label, KNOWN) & ~self.held_out)

    @property
    def unknown(self) -> npt.NDArray[np.bool_]:
        """Rows of `following`."""
        return np.asarray(self.label == Intention.FOLLOWING)

    @property
    def held_out(self) -> npt.NDArray[np.bool_]:
        """Rows of the intention left out of training."""
        return np.asarray(self.label == (-1 if self.left_out is None else int(self.left_out)))

    @property
    def predicted(self) -> IntArray:
        """The likeliest intention, (n,)."""
        return np.asarray(self.outputs.logits.argmax(axis=1), dtype=np.int64)


def answers(run: Run, records: Records, ends: Ends) -> Answers:
    """The run's outputs on those windows. InputError where the records have other rates than it was trained on."""
    if (records.tv_rate_hz, records.uv_rate_hz) != (run.card.tv_rate_hz, run.card.uv_rate_hz):
        raise InputError(
            f"{run.path}: trained on {run.card.tv_rate_hz:g} and {run.card.uv_rate_hz:g} Hz, the dataset has "
            f"{records.tv_rate_hz:g} and {records.uv_rate_hz:g} Hz; train on a dataset of the same rates"
        )
    parts = [run.predictor(w) for w in batches(records, ends, run.card.settings.windows, BATCH)]
    outputs = Outputs(np.concatenate([p.logits for p in parts]), np.concatenate([p.features for p in parts]))
    table = records.table.iloc[ends.row]
    lead = table["t_commit"].to_numpy(dtype=np.float64) - ends.times(records)
    snr = table["snr_db"].to_numpy(dtype=np.float64)
    left_out = run.card.settings.left_out
    return Answers(outputs, records.label[ends.row], records.groups[ends.row], lead, snr, left_out)


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
