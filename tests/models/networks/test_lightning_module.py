"""The windows of an epoch: the same order every time, wherever the states are, and disjoint on several devices."""

from __future__ import annotations

import pickle
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from isac_cosim.labeling.intentions import KNOWN
from isac_cosim.models.data import windows
from isac_cosim.models.data.augment import AugmentSettings
from isac_cosim.models.data.windows import Ends, Records
from isac_cosim.models.networks import lightning_module
from isac_cosim.models.networks.lightning_module import Batch, WindowData
from isac_cosim.models.runs.settings import TrainSettings
from tests.support.made_up import SMALL_RUN, on_disk

AUGMENTED = SMALL_RUN.model_copy(update={"augment": AugmentSettings(turn_deg=5.0, mirror_share=0.5, noise_m=0.1)})


def epoch(records: Records, settings: TrainSettings, number: int, rank: int = 0, devices: int = 1) -> list[Batch]:
    """The batches that a device gets in an epoch."""
    known = records.take(np.isin(records.label, KNOWN))
    data = WindowData(known, known, settings)
    data.trainer = SimpleNamespace(global_rank=rank, world_size=devices, current_epoch=number)  # type: ignore[assignment]
    return list(data.train_dataloader())


def equal(one: list[Batch], other: list[Batch]) -> bool:
    pairs = zip(one, other, strict=True)
    return all(torch.equal(a, b) for batch, again in pairs for a, b in zip(batch, again, strict=True))


@pytest.mark.parametrize("settings", [SMALL_RUN, AUGMENTED])
def test_devices_share_the_windows_of_an_epoch(records: Records, settings: TrainSettings) -> None:
    """Put together, their parts are the batches of a single device, in each epoch another order."""
    whole = [epoch(records, settings, number) for number in (0, 1)]
    assert not equal(*whole)
    for count in (2, 3):
        parts = [epoch(records, settings, 1, rank, count) for rank in range(count)]
        for k, batch in enumerate(whole[1]):
            for rank, part in enumerate(parts):
                assert all(torch.equal(mine, values[rank::count]) for mine, values in zip(part[k], batch, strict=True))


def test_each_window_is_read_by_one_device(records: Records, monkeypatch: pytest.MonkeyPatch) -> None:
    read: list[tuple[int, int]] = []

    def cut(source: Records, ends: Ends, settings: windows.WindowSettings) -> windows.Windows:
        read.extend(zip(ends.row.tolist(), ends.step.tolist(), strict=True))
        return windows.cut(source, ends, settings)

    monkeypatch.setattr(lightning_module, "cut", cut)
    parts = [epoch(records, SMALL_RUN, 0, rank, 2) for rank in range(2)]
    assert len(read) == len(set(read)) == sum(len(batch[2]) for part in parts for batch in part)


def test_the_order_is_the_same_from_disk_and_in_another_process(records: Records) -> None:
    stored = on_disk(records)
    sent = replace(stored, tv=pickle.loads(pickle.dumps(stored.tv)), uv=pickle.loads(pickle.dumps(stored.uv)))
    inside = epoch(records, SMALL_RUN, 2)
    assert equal(inside, epoch(records, SMALL_RUN, 2))
    assert equal(inside, epoch(stored, SMALL_RUN, 2))
    assert equal(inside, epoch(sent, SMALL_RUN, 2))
