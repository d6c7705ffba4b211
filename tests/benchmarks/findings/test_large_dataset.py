"""The benchmark of large datasets reports the same windows from memory and from disk."""

from pathlib import Path

import pytest

import isac_cosim.benchmarks.findings.large_dataset
from isac_cosim.benchmarks.findings.memory import STATUS
from isac_cosim.labeling.dataset.dataset import Dataset


@pytest.mark.skipif(not STATUS.is_file(), reason="reads /proc, which only Linux has")
def test_a_small_dataset_is_measured(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(isac_cosim.benchmarks.findings.large_dataset, "PER_SHARD", 40)
    isac_cosim.benchmarks.findings.large_dataset.write_made_up(tmp_path, 100)
    dataset = Dataset.open(tmp_path)
    dataset.verify()
    assert [shard.samples for shard in dataset.meta.shards] == [40, 40, 20]
    for kind in isac_cosim.benchmarks.findings.large_dataset.LIMITS:
        result = isac_cosim.benchmarks.findings.large_dataset.measure(str(tmp_path), kind)
        assert result["windows_per_s"] > 0.0
        assert result["anonymous_mib"] >= result["anonymous_mib_before"] > 1.0
