"""States on disk are those in memory, and only what is needed is read."""

import pickle
from pathlib import Path

import numpy as np
import pytest

from isac_cosim.base.errors import OutputError
from isac_cosim.labeling.dataset.dataset import Dataset
from isac_cosim.models.data import states
from isac_cosim.models.data.states import StatesOnDisk
from isac_cosim.models.data.windows import Records, WindowSettings, cut, draw_ends
from tests.support.made_up_dataset import write_dataset


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return write_dataset(tmp_path_factory.mktemp("states") / "data", seeds=3)


def on_disk(dataset: Dataset) -> Records:
    return Records.of(dataset, in_memory_bytes=0)


def test_windows_are_the_same_to_the_last_bit(dataset: Dataset) -> None:
    settings = WindowSettings()
    inside, outside = Records.of(dataset), on_disk(dataset)
    assert isinstance(inside.tv, np.ndarray)
    assert isinstance(outside.tv, StatesOnDisk)
    assert (outside.tv.shape, outside.uv.shape) == (inside.tv.shape, inside.uv.shape)
    keep = inside.label < 4
    for a, b in ((inside, outside), (inside.take(keep), outside.take(keep)), (inside.take(np.array([5, 2])),) * 2):
        ends = draw_ends(a, settings, "test", 1)
        assert len(ends) == len(draw_ends(b, settings, "test", 1)) > 0
        for name in ("tv", "uv"):
            np.testing.assert_array_equal(getattr(cut(a, ends, settings), name), getattr(cut(b, ends, settings), name))
    np.testing.assert_array_equal(outside.take(keep).tv[1], inside.tv[np.flatnonzero(keep)[1]])


def test_windows_are_those_that_an_index_takes_out() -> None:
    rng = np.random.default_rng(1)
    values = rng.standard_normal((5, 6, 40)).astype(np.float32)
    row, last = rng.integers(0, 5, 12), rng.integers(9, 40, 12)
    index = last[:, None] + np.arange(-9, 1)
    expected = values[row[:, None, None], np.arange(6)[None, :, None], index[:, None, :]]
    np.testing.assert_array_equal(states.windows_of(values, row, last, 10), expected)


def test_only_the_columns_that_are_needed_are_read(dataset: Dataset, monkeypatch: pytest.MonkeyPatch) -> None:
    read: list[str] = []
    whole = Dataset._table
    monkeypatch.setattr(Dataset, "_table", lambda self, shard, names: read.extend(names) or whole(self, shard, names))
    for open_records in (Records.of, on_disk):
        open_records(dataset)
    assert {"tv", "uv", "label"} <= set(read)
    assert "tv_truth" not in read


def test_one_record_is_read_from_its_shard(dataset: Dataset) -> None:
    truth = dataset.arrays("tv_truth")["tv_truth"]
    for row in (0, 13, 14, len(dataset) - 1):
        np.testing.assert_array_equal(dataset.record("tv_truth", row), truth[row])
    with pytest.raises(IndexError, match="the dataset has 42 rows"):
        dataset.record("tv_truth", len(dataset))


def test_another_process_maps_the_same_file_and_does_not_delete_it(dataset: Dataset) -> None:
    records = on_disk(dataset)
    assert isinstance(records.tv, StatesOnDisk)
    first = records.tv[0]
    sent = pickle.dumps(records.tv)
    assert len(sent) < 2000
    there = pickle.loads(sent)
    np.testing.assert_array_equal(there[0], first)
    del there
    path = records.tv.path
    assert path.exists()
    del records
    assert not path.exists()


def test_a_full_disk_is_an_error_of_one_line(dataset: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "missing"))
    with pytest.raises(OutputError, match=r"temporary files cannot be written \(.*missing: .*; .* set TMPDIR"):
        on_disk(dataset)
