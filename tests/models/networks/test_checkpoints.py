"""Checkpoints: whole or not there, on a full disk too, and data, never code."""

from __future__ import annotations

import os
import pickle
from collections import OrderedDict
from pathlib import Path

import numpy as np
import pytest
import torch

from isac_cosim.base.errors import InputError, OutputError
from isac_cosim.models.data.windows import Records
from isac_cosim.models.networks import fitting
from isac_cosim.models.networks.checkpoints import read_tensors, write_tensors
from isac_cosim.models.networks.lightning_checkpoints import PARTS, Checkpoints
from isac_cosim.models.runs.run import Run
from isac_cosim.models.training.training import train_records
from tests.support.made_up import MADE_OF, SMALL_RUN


class Evil:
    """A pickle that would leave a file behind."""

    def __init__(self, mark: Path) -> None:
        self.mark = mark

    def __reduce__(self):  # type: ignore[no-untyped-def]
        return Path.touch, (self.mark,)


def partial_of(path: Path) -> Path:
    """The temporary file that becomes a file of a run."""
    return path.with_name(f".{os.getpid()}-{path.name}")


class FullDisk(fitting.History):
    """From the second epoch on no byte more fits into the files named."""

    files: tuple[Path, ...] = ()

    def on_train_batch_start(self, trainer, *_):  # type: ignore[no-untyped-def]
        for file in self.files if trainer.current_epoch == 1 else ():
            if not partial_of(file).is_symlink():
                partial_of(file).symlink_to("/dev/full")


@pytest.mark.parametrize(
    "name",
    ["checkpoints/last.ckpt", *(pytest.param(name, marks=pytest.mark.slow) for name in ("weights.pt", "history.csv"))],
)
def test_a_training_goes_on_after_a_full_disk(
    name: str, records: Records, network_run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "run"
    with monkeypatch.context() as patched:
        patched.setattr(fitting, "History", FullDisk)
        patched.setattr(FullDisk, "files", (folder / name,))
        with pytest.raises(OutputError, match=rf"{Path(name).name}: cannot be written \(No space left on device\)"):
            train_records(records, MADE_OF, folder, SMALL_RUN)
    assert [path for path in folder.rglob(".*-*") if not path.is_symlink()] == []
    torch.load(folder / "checkpoints/last.ckpt", weights_only=True)
    for path in folder.rglob(".*-*"):
        path.unlink()
    resumed = train_records(records, MADE_OF, folder, SMALL_RUN)
    assert (folder / "history.csv").read_bytes() == (network_run.path / "history.csv").read_bytes()
    first, second = (read_tensors(run.path / "weights.pt") for run in (network_run, resumed))
    assert all(torch.equal(first[key], second[key]) for key in first)


def test_what_is_written_is_read_back(tmp_path: Path) -> None:
    content = {"a": torch.arange(5.0), "n": 3, "name": "x"}
    write_tensors(tmp_path / "a.pt", content)
    stored = read_tensors(tmp_path / "a.pt")
    assert torch.equal(stored.pop("a"), content.pop("a"))
    assert stored == content
    assert [path.name for path in tmp_path.iterdir()] == ["a.pt"]


@pytest.mark.parametrize(
    "how", ["pickle", *(pytest.param(how, marks=pytest.mark.slow) for how in ("torch", "numpy", "cut"))]
)
def test_a_damaged_or_foreign_checkpoint_is_refused_and_executes_nothing(
    how: str, records: Records, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Stop(fitting.History):
        def on_train_batch_start(self, trainer, *_):  # type: ignore[no-untyped-def]
            if trainer.current_epoch == 1:
                raise KeyboardInterrupt

    run, mark = tmp_path / "run", tmp_path / "mark"
    with monkeypatch.context() as patched:
        patched.setattr(fitting, "History", Stop)
        with pytest.raises(KeyboardInterrupt):
            train_records(records, MADE_OF, run, SMALL_RUN)
    last = run / "checkpoints/last.ckpt"
    if how == "torch":
        torch.save({"state_dict": Evil(mark)}, last)
    elif how == "pickle":
        last.write_bytes(pickle.dumps(Evil(mark), protocol=2))
    elif how == "numpy":
        with last.open("wb") as file:
            np.save(file, np.array([Evil(mark)], object))
    else:
        last.write_bytes(last.read_bytes()[:1000])
    with pytest.raises(InputError, match=r"last\.ckpt: is damaged .*delete it"):
        train_records(records, MADE_OF, run, SMALL_RUN)
    assert not mark.exists()
    last.unlink()
    assert train_records(records, MADE_OF, run, SMALL_RUN).card.complete


def test_two_trainings_of_a_network_give_the_same_bytes(records: Records, network_run: Run, tmp_path: Path) -> None:
    """Every file of the run's folder, wherever that is; neither times nor paths reach a file."""
    again = train_records(records, MADE_OF, tmp_path / "elsewhere" / "run", SMALL_RUN)
    first, second = (
        {str(path.relative_to(run.path)): path.read_bytes() for path in run.path.rglob("*") if path.is_file()}
        for run in (network_run, again)
    )
    assert {"weights.pt", "checkpoints/last.ckpt", "checkpoints/best.ckpt", "history.csv", "pre_onset.skops"} <= set(
        first
    )
    assert set(first) == set(second)
    assert [name for name, content in first.items() if content != second[name]] == []


def score_of(epoch: int) -> float:
    """A score that is best in the epochs 1 and 2, and then falls."""
    return 0.6 if epoch in (1, 2) else 0.4


@pytest.mark.parametrize(
    "interrupted", [*(pytest.param(epoch, marks=pytest.mark.slow) for epoch in (0, 1, 2, 3)), "end"]
)
def test_a_training_that_was_interrupted_gives_the_same_bytes(
    interrupted: int | str, records: Records, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first of two epochs that are equally good is kept, in a relative folder too; nobody trains on for longer."""

    class Scored(fitting.NetworkModule):
        def on_validation_epoch_end(self) -> None:
            super().on_validation_epoch_end()
            self.log(fitting.MONITOR, score_of(self.current_epoch))

    class Interrupted(fitting.History):
        asked = True

        def on_train_batch_start(self, trainer, *_):  # type: ignore[no-untyped-def]
            if self.asked and trainer.current_epoch == interrupted:
                raise KeyboardInterrupt

        def on_train_end(self, *_):  # type: ignore[no-untyped-def]
            if self.asked and interrupted == "end":
                raise KeyboardInterrupt

        @property
        def state_key(self) -> str:
            return "History"

    optimiser = SMALL_RUN.optimiser.model_copy(update={"epochs": 6, "patience": 2})
    settings = SMALL_RUN.model_copy(update={"optimiser": optimiser})
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(fitting, "NetworkModule", Scored)
    undisturbed = train_records(records, MADE_OF, Path("undisturbed"), settings)
    monkeypatch.setattr(fitting, "History", Interrupted)
    with pytest.raises(KeyboardInterrupt):
        train_records(records, MADE_OF, Path("resumed"), settings)
    Interrupted.asked = False
    resumed = train_records(records, MADE_OF, Path("resumed"), settings)
    assert resumed.card.best_epoch == 1
    assert len((undisturbed.path / "history.csv").read_text().splitlines()) == 1 + 4
    differing = [
        path
        for path in undisturbed.path.rglob("*")
        if path.is_file() and path.read_bytes() != (resumed.path / path.relative_to(undisturbed.path)).read_bytes()
    ]
    assert differing == []


def test_equal_checkpoints_give_the_same_bytes_whatever_objects_they_share(tmp_path: Path) -> None:
    """As after a resumed training, some of whose texts come from a file."""
    text, other = "learning_rate", "".join(["learning", "_rate"])
    assert text is not other
    for name, second in (("one", text), ("two", other)):
        states = OrderedDict({text: torch.ones(2)}), {second: (second, [second])}
        content = {part: {} for part in PARTS} | {"state_dict": states[0], "optimizer_states": [states[1]]}
        Checkpoints().save_checkpoint(content, tmp_path / name / "last.ckpt")
    one, two = (tmp_path / name / "last.ckpt" for name in ("one", "two"))
    assert one.read_bytes() == two.read_bytes()
    assert Checkpoints().load_checkpoint(two)["optimizer_states"] == [{text: (text, [text])}]


def test_paths_in_a_checkpoint_are_relative_to_its_folder(tmp_path: Path) -> None:
    first, second = tmp_path / "first", tmp_path / "second"
    kept = {"dirpath": str(first), "best": {str(first / "best.ckpt"): 0.5}, "other": f"{first}_too", "score": 0.5}
    others = {name: {} for name in PARTS} | {"epoch": 3}
    Checkpoints().save_checkpoint({**others, "callbacks": {"keeper": kept}}, first / "last.ckpt")
    assert str(first / "best.ckpt").encode() not in (first / "last.ckpt").read_bytes()
    first.rename(second)
    content = Checkpoints().load_checkpoint(second / "last.ckpt")
    expected = {"dirpath": str(second), "best": {str(second / "best.ckpt"): 0.5}, "other": f"{first}_too", "score": 0.5}
    assert content == {**others, "callbacks": {"keeper": expected}}


@pytest.mark.parametrize("part", PARTS)
def test_a_checkpoint_without_one_of_its_parts_is_damaged(part: str, tmp_path: Path) -> None:
    write_tensors(tmp_path / "last.ckpt", {name: {} for name in PARTS if name != part})
    with pytest.raises(InputError, match=rf"last\.ckpt: is damaged \({part}: is missing\)"):
        Checkpoints().load_checkpoint(tmp_path / "last.ckpt")


def test_a_flipped_bit_in_a_checkpoint_is_noticed(tmp_path: Path) -> None:
    path = tmp_path / "last.ckpt"
    write_tensors(path, {"weight": torch.ones(1000)})
    content = bytearray(path.read_bytes())
    content[content.index(torch.ones(8).numpy().tobytes())] ^= 1
    path.write_bytes(content)
    with pytest.raises(InputError, match="checksum"):
        read_tensors(path)
