"""Windows to train a network on, in files: those of hundreds of vehicle-hours do not fit into memory."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np
import torch
from torch import Tensor
from torch.utils.data import Dataset

from isac_cosim.base.arrays import Float32Array
from isac_cosim.base.errors import InputError
from isac_cosim.base.feedback import Feedback
from isac_cosim.base.temporary import writing_temporary
from isac_cosim.models.data.windows import Windows
from isac_cosim.models.hazards.decisions import StreamSide

Inputs = tuple[Float32Array, ...]
"""What a network sees of n windows, arrays (n, ...)."""


@dataclass(frozen=True)
class StoredWindows(Dataset[tuple[Tensor, ...]]):
    """Items are what the network sees of a window, then interval (5,), passing () and weight () of its decision.

    inputs: arrays on disk. interval, passing, weight: of all decisions.
    """

    inputs: tuple[Float32Array, ...]
    interval: Tensor
    passing: Tensor
    weight: Tensor

    def __len__(self) -> int:
        return len(self.weight)

    def __getitem__(self, k: int) -> tuple[Tensor, ...]:
        values = [torch.from_numpy(np.array(array[k])) for array in self.inputs]
        return *values, self.interval[k], self.passing[k], self.weight[k]

    def some(self, most: int) -> list[Tensor]:
        """Return the inputs of at most so many windows, from all over the streams."""
        rows = np.unique(np.linspace(0, len(self) - 1, min(most, len(self))).astype(np.int64))
        return [torch.from_numpy(np.array(array[rows])) for array in self.inputs]

    @classmethod
    def written(cls, folder: Path, side: StreamSide, inputs: Callable[[Windows], Inputs], feedback: Feedback) -> Self:
        """Cut the windows of a side into files in a new folder. Raises InputError if it has no decision."""
        answers: list[tuple[np.ndarray, ...]] = []
        shapes: list[tuple[int, ...]] = []
        with writing_temporary(), feedback.bar("reading streams", "episodes") as move:
            folder.mkdir()
            for batch in side.batches(move):
                arrays = inputs(batch.windows)
                shapes = [array.shape[1:] for array in arrays]
                for number, array in enumerate(arrays):
                    with (folder / f"{number}.f32").open("ab") as file:
                        file.write(np.ascontiguousarray(array, np.float32).data)
                answers.append((batch.targets.interval, batch.targets.passing, batch.weight))
        if not answers:
            raise InputError(f"{side.streams.path}: no decision to train on; generate more streams")
        interval, passing, weight = (torch.from_numpy(np.concatenate(part)) for part in zip(*answers, strict=True))
        stored = [
            np.memmap(folder / f"{number}.f32", np.float32, "r", shape=(len(weight), *shape))
            if np.prod(shape)
            else np.empty((len(weight), *shape), np.float32)
            for number, shape in enumerate(shapes)
        ]
        return cls(tuple(stored), interval, passing, weight.float())
