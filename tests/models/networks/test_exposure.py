"""Outlier exposure: the pre-onset windows in an epoch, their loss, and what a network learns from them."""

from pathlib import Path

import numpy as np
import pytest
import torch

from isac_cosim.evaluation.on_windows.predictions import predict
from isac_cosim.labeling.intentions import KNOWN
from isac_cosim.models.data.fit_settings import LossSettings
from isac_cosim.models.data.pre_onset import pre_onset_windows
from isac_cosim.models.data.windows import Records, draw_ends
from isac_cosim.models.networks.lightning_module import OUTLIER, WindowData
from isac_cosim.models.networks.losses import exposure_loss
from isac_cosim.models.runs.run import Run
from isac_cosim.models.training.training import train_records
from tests.support.made_up import MADE_OF, SMALL_RUN

EXPOSED = SMALL_RUN.model_copy(update={"loss": LossSettings(exposure_weight=1.0)})


def test_the_loss_is_cross_entropy_against_equal_probabilities() -> None:
    logits = torch.randn(20, 6, generator=torch.Generator().manual_seed(0))
    expected = torch.nn.functional.cross_entropy(logits, torch.full((20, 6), 1 / 6))
    torch.testing.assert_close(exposure_loss(logits), expected)


def test_an_epoch_holds_as_many_pre_onset_windows_and_the_same_known_windows(records: Records) -> None:
    known = records.take(np.isin(records.label, KNOWN))
    plain, exposed = (WindowData(known, known, settings) for settings in (SMALL_RUN, EXPOSED))
    ends, label = exposed.epoch_windows(3)
    outlier = label == OUTLIER
    assert outlier.sum() == (~outlier).sum() == len(known)
    before = known.table["t_onset"].to_numpy()[ends.row] - ends.times(known)
    assert before[outlier].min() >= 0.1 - 1e-6
    assert before[~outlier].max() < 0
    np.testing.assert_array_equal(label[~outlier], known.label[ends.row[~outlier]])
    plain_ends, plain_label = plain.epoch_windows(3)
    not_outliers = set(zip(ends.row[~outlier], ends.step[~outlier], strict=True))
    assert not_outliers == set(zip(plain_ends.row, plain_ends.step, strict=True))
    np.testing.assert_array_equal(plain_label, known.label[plain_ends.row])


@pytest.mark.slow
def test_exposure_lowers_the_confidence_on_pre_onset_windows(
    records: Records, network_run: Run, tmp_path: Path
) -> None:
    run = train_records(records, MADE_OF, tmp_path / "run", EXPOSED)
    left = records.take(np.isin(records.groups, run.card.split["test"]) & np.isin(records.label, KNOWN))
    shown = pre_onset_windows(SMALL_RUN.windows, SMALL_RUN.pre_onset)
    confidence = []
    for trained in (network_run, run):
        ends = draw_ends(left, shown, "test")
        confidence.append(predict(trained, left, ends).outputs.probabilities.max(axis=1).mean())
    assert confidence[1] < confidence[0] - 0.05
