"""A dataset as `isac_cosim.open` gives it: its samples can be drawn, and its windows go to PyTorch and Lightning."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from isac_cosim.base.errors import InputError
from isac_cosim.base.files import replace_file
from isac_cosim.base.registry import nearest
from isac_cosim.base.temporary import TemporaryFolder
from isac_cosim.labeling.dataset.dataset import Dataset
from isac_cosim.labeling.dataset.finding import find_sample

if TYPE_CHECKING:
    from isac_cosim.models.data.labelled_windows import LabelledWindows
    from isac_cosim.models.data.windows import Records
    from isac_cosim.models.networks.lightning_module import WindowData
    from isac_cosim.models.runs.run import Run
    from isac_cosim.models.runs.settings import TrainSettings

Side = Literal["train", "validation", "test"]
SIDES: tuple[Side, ...] = ("train", "validation", "test")


@dataclass(frozen=True, repr=False)
class Drawing:
    """A drawing, which notebooks show by themselves. png: the bytes of the file. title: what it shows."""

    png: bytes
    title: str

    def __repr__(self) -> str:
        return f"<Drawing: {self.title}>"

    def _repr_png_(self) -> bytes:
        return self.png

    def save(self, path: str | Path) -> Path:
        """Write the drawing as a PNG file, and return its path. Raises OutputError."""
        replace_file(Path(path), lambda partial: partial.write_bytes(self.png))
        return Path(path)


@dataclass(frozen=True, repr=False)
class OpenedDataset(Dataset):
    """A dataset that is open for reading, with what people do next: look at a sample, take windows."""

    def plot(self, k: int | str, run: Run | None = None) -> Drawing:
        """Draw a sample: the road from above, what was sensed over the truth, and what a run answers along it.

        k: row of the sample in `frame()`, or its `sample_id`. run: a trained predictor, `isac_cosim.load(...).run`.
        Raises IndexError or InputError where there is no such sample.
        """
        from isac_cosim.evaluation.report.report import draw_sample

        row = find_sample(self, k) if isinstance(k, str) else range(len(self))[k]
        with TemporaryFolder() as folder:
            path = folder.path / "sample.png"
            draw_sample(self, row, path, run)
            return Drawing(path.read_bytes(), str(k) if isinstance(k, str) else f"sample {row} of {self.path}")

    def windows(
        self, split: Side = "train", settings: TrainSettings | None = None, epoch: int = 0, unknown: bool = False
    ) -> LabelledWindows:
        """Return the windows of one side of the split, as a dataset of PyTorch.

        The split is that of `cosim train`, the frame and the ends of windows are as there, and on the test side as in
        `cosim evaluate`.

        split: "train", "validation" or "test". settings: of the training; they decide on all of this. epoch: from 0;
        each has its own windows on the training side. unknown: whether `following`, label 6, and an intention that is
        held out are among them.
        Raises InputError where there are fewer than three seeds, or no record holds such a window.
        """
        from isac_cosim.evaluation.on_windows.settings import EvaluateSettings
        from isac_cosim.models.data.labelled_windows import LabelledWindows, epoch_ends, validation_ends
        from isac_cosim.models.data.sides import on_side, taught
        from isac_cosim.models.data.windows import draw_ends
        from isac_cosim.models.runs.settings import TrainSettings

        if split not in SIDES:
            raise InputError(f"split {split!r}: {nearest(str(split), SIDES)}choose one of {', '.join(SIDES)}")
        chosen, sides = settings or TrainSettings(), self.split(settings)
        validation = taught(self.records, sides, "validation", chosen)
        if unknown:
            records = self.records.take(on_side(self.records, sides, split, chosen.split))
        else:
            records = validation if split == "validation" else taught(self.records, sides, split, chosen)
        if split == "train":
            ends = epoch_ends(records, chosen, epoch)
        elif split == "validation":
            ends = validation_ends(records, chosen)
        else:
            measured = EvaluateSettings()
            ends = draw_ends(records, chosen.windows, "evaluate", measured.seed, per_record=measured.ends_per_record)
        return LabelledWindows(split, records, ends, chosen, validation)

    def data_module(self, settings: TrainSettings | None = None) -> WindowData:
        """Return the windows of training and validation as Lightning takes them: `trainer.fit(module, datamodule=...)`.

        Batches are (tv, uv, label), as this tool's own networks are trained on: the training windows are drawn anew in
        each epoch, and augmented as the settings say.
        """
        from isac_cosim.models.data.sides import taught
        from isac_cosim.models.networks.lightning_module import WindowData
        from isac_cosim.models.runs.settings import TrainSettings

        chosen, sides = settings or TrainSettings(), self.split(settings)
        sent = replace(self.records, lane_maps=None)
        return WindowData(taught(sent, sides, "train", chosen), taught(sent, sides, "validation", chosen), chosen)

    def split(self, settings: TrainSettings | None = None) -> dict[str, list[str]]:
        """Return the episodes, `SCENARIO-SEED`, of each side of the split. Raises InputError below three seeds."""
        from isac_cosim.models.data.split import split
        from isac_cosim.models.runs.settings import TrainSettings

        return split(self.records, (settings or TrainSettings()).split)

    @cached_property
    def records(self) -> Records:
        """All records, in memory, or on disk where they are large."""
        from isac_cosim.models.data.windows import Records

        return Records.of(self)
