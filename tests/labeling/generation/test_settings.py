"""Study files: what is read, and the one line that says what is wrong."""

from __future__ import annotations

from pathlib import Path

import pytest

from isacsim.errors import InputError
from labeling.generation.settings import DatasetStudy, SeedRange, checked, read_toml


def test_a_study_reads_back_from_what_it_writes() -> None:
    study = DatasetStudy(seeds=SeedRange(first=3, last=5))
    assert DatasetStudy.model_validate(study.model_dump(mode="json")) == study
    assert list(study.seeds) == [3, 4, 5]
    assert len(study.seeds) == 3


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ({"sed": 1}, "sed: unknown key"),
        ({"sensing": {"chanel": {}}}, "sensing.chanel: unknown key"),
        ({"seeds": {"first": 5, "last": 4}}, "seeds: last (4) is below first (5)"),
        ({"seeds": {"first": -1}}, "seeds.first: Input should be greater than or equal to 0, not -1"),
        ({"traffic": {"duration_s": "long"}}, "traffic.duration_s: Input should be a valid number"),
        ({"sensing": {"channel": {"snr_range_db": [10, 0]}}}, "sensing.channel: snr_range_db 10:0 is no range"),
        ({"scenarios": []}, "scenarios: "),
        ({"selection": {"windows": 0}}, "selection.windows: "),
    ],
)
def test_a_fault_is_one_line_with_the_path_of_the_key(content: dict[str, object], said: str) -> None:
    with pytest.raises(InputError) as error:
        checked(DatasetStudy, content, "my.toml")
    message = str(error.value)
    assert message.startswith(f"my.toml: {said}")
    assert "\n" not in message
    assert "pydantic" not in message


def test_files_that_are_no_toml_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such study file"):
        read_toml(tmp_path / "none.toml")
    (tmp_path / "bad.toml").write_text("seeds = {")
    with pytest.raises(InputError, match="not a readable TOML file"):
        read_toml(tmp_path / "bad.toml")
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="not a readable TOML file"):
        read_toml(tmp_path / "binary.toml")
    with pytest.raises(InputError, match="not a readable TOML file"):
        read_toml(tmp_path)
