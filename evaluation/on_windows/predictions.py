"""A run's predictions on windows that no choice was made on, with what is known of each window."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from isac_cosim.base.arrays import Array, BoolArray, IntArray
from isac_cosim.base.errors import InputError
from isac_cosim.labeling.intentions import KNOWN, Intention
from isac_cosim.models.data.windows import Ends, Records, WindowSettings, batches, end_bounds
from isac_cosim.models.predictors.protocol import Outputs
from isac_cosim.models.runs.run import Run

BATCH = 64
"""Windows that are predicted at once."""
LEFT, RIGHT = Intention.LEFT_LANE_CHANGE, Intention.RIGHT_LANE_CHANGE
TOLERANCE_S = 1e-6
"""Times that differ by less are equal but for rounding, s."""


@dataclass(frozen=True)
class Predictions:
    """A run's outputs on n windows.

    outputs: logits (n, G) and features (n, F).
    label: true intention of each window, (n,).
    sample_id, group: sample and scenario seed (`<scenario>-<seed>`) that the window was cut from, (n,).
    end_s: end of the window, s of simulation time, (n,).
    lead_s: commit minus end of the window, s, (n,).
    snr_db: mean per-element SNR of the window's record, dB, (n,).
    after_onset_s: end of the window minus onset, s, (n,).
    origin: whether the maneuver is natural, a reaction or commanded, (n,).
    n_sites: number of sites that sensed the record, (n,).
    keeps_left: whether traffic keeps left, (n,).
    left_out: the intention that was left out of the run's training, if any.
    """

    outputs: Outputs
    label: IntArray
    sample_id: npt.NDArray[np.object_]
    group: npt.NDArray[np.object_]
    end_s: Array
    lead_s: Array
    snr_db: Array
    after_onset_s: Array
    origin: npt.NDArray[np.object_]
    n_sites: IntArray
    keeps_left: BoolArray
    left_out: Intention | None = None

    @property
    def known(self) -> npt.NDArray[np.bool_]:
        """Windows of an intention that the run was trained on, a mask (n,)."""
        return np.asarray(np.isin(self.label, KNOWN) & ~self.held_out)

    @property
    def unknown(self) -> npt.NDArray[np.bool_]:
        """Windows of `following`, a mask (n,)."""
        return np.asarray(self.label == Intention.FOLLOWING)

    @property
    def held_out(self) -> npt.NDArray[np.bool_]:
        """Windows of the intention left out of training, a mask (n,)."""
        return np.asarray(self.label == (-1 if self.left_out is None else int(self.left_out)))

    @property
    def before_commit(self) -> npt.NDArray[np.bool_]:
        """Known windows that end at or after the onset and before the commit, a mask (n,)."""
        return np.asarray(self.known & (self.after_onset_s > -TOLERANCE_S) & (self.lead_s > TOLERANCE_S))

    @property
    def after_commit(self) -> npt.NDArray[np.bool_]:
        """Known windows that end at or after the commit, a mask (n,)."""
        return np.asarray(self.known & (self.lead_s <= TOLERANCE_S))

    @property
    def by_faster_side(self) -> Predictions:
        """The same predictions with left and right lane changes swapped where traffic keeps left.

        A left lane change is then one to the faster side everywhere, the side to which an overtake pulls out.
        """
        swapped = np.arange(len(Intention))
        swapped[[LEFT, RIGHT]] = RIGHT, LEFT
        logits = self.outputs.logits.copy()
        logits[self.keeps_left] = logits[self.keeps_left][:, swapped[: logits.shape[1]]]
        label = np.where(self.keeps_left, swapped[self.label], self.label)
        return replace(self, outputs=Outputs(logits, self.outputs.features), label=label)

    @property
    def predicted(self) -> IntArray:
        """The likeliest intention of each window, (n,)."""
        return np.asarray(self.outputs.logits.argmax(axis=1), dtype=np.int64)


def ends_at_lead(records: Records, windows: WindowSettings, lead_s: float) -> Ends:
    """Return the ends of the windows that end `lead_s` before the commit, one for each record that holds such a window.

    Records of known intentions only; windows that would end before the onset are left out. The end is the nearest
    sample of the UV.
    """
    fixed = WindowSettings.model_validate(
        {**windows.model_dump(), "relative_to": "commit", "end_after_s": (-lead_s, -lead_s)}
    )
    step, last = end_bounds(records, fixed)
    onset_s = (records.table["t_onset"] - records.table["t_start"]).to_numpy(dtype=np.float64)
    usable = (last >= step) & (step / records.uv_rate_hz > onset_s - TOLERANCE_S) & np.isin(records.label, KNOWN)
    rows = np.flatnonzero(usable)
    return Ends(rows, step[rows])


def predict(run: Run, records: Records, ends: Ends) -> Predictions:
    """Return the run's predictions on the windows with those ends.

    Raises InputError where the records have other sampling rates than the run was trained on.
    """
    check_rates(run, records)
    parts = [run.answer(windows) for windows in batches(records, ends, run.card.settings.windows, BATCH)]
    table, end_s = records.table.iloc[ends.row], ends.times(records)
    return Predictions(
        outputs=Outputs(
            np.concatenate([part.logits for part in parts]), np.concatenate([part.features for part in parts])
        ),
        label=records.label[ends.row],
        sample_id=table["sample_id"].to_numpy(dtype=object),
        group=records.groups[ends.row],
        end_s=end_s,
        lead_s=table["t_commit"].to_numpy(dtype=np.float64) - end_s,
        snr_db=table["snr_db"].to_numpy(dtype=np.float64),
        after_onset_s=end_s - table["t_onset"].to_numpy(dtype=np.float64),
        origin=table["origin"].to_numpy(dtype=object),
        n_sites=table["n_sites"].to_numpy(dtype=np.int64),
        keeps_left=records.keeps_left[ends.row],
        left_out=run.card.settings.left_out,
    )


def unseen(records: Records, runs: Sequence[Run]) -> Records:
    """Return the records of scenario seeds that none of the runs was trained or chosen on.

    Seeds that a run with a smaller training share left unused are not test seeds either, so that runs with any share
    are measured on the same seeds. Raises InputError where no record of a known intention is left.
    """
    seen = {group for run in runs for side, groups in run.card.split.items() if side != "test" for group in groups}
    left = ~np.isin(records.groups, list(seen))
    if not (left & np.isin(records.label, KNOWN)).any():
        raise InputError("every scenario seed of the dataset was used in training; evaluate on other seeds")
    return records.take(left)


def check_rates(run: Run, records: Records) -> None:
    """Raise InputError where the records have other sampling rates than the run was trained on."""
    if (records.tv_rate_hz, records.uv_rate_hz) != (run.card.tv_rate_hz, run.card.uv_rate_hz):
        raise InputError(
            f"{run.path}: trained on {run.card.tv_rate_hz:g} and {run.card.uv_rate_hz:g} Hz, but the dataset has "
            f"{records.tv_rate_hz:g} and {records.uv_rate_hz:g} Hz; train on a dataset with the same rates"
        )
