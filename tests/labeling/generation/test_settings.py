"""Study files: what is read, and the one line that says what is wrong."""

from __future__ import annotations

import pytest

from isac_cosim.base.errors import InputError
from isac_cosim.base.settings import checked
from isac_cosim.labeling.generation.settings import DatasetStudy, SeedRange


def test_a_study_reads_back_from_what_it_writes() -> None:
    study = DatasetStudy(seeds=SeedRange(first=3, last=5))
    assert DatasetStudy.model_validate(study.model_dump(mode="json")) == study
    assert list(study.seeds) == [3, 4, 5]
    assert len(study.seeds) == 3


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        ({"sed": 1}, "sed: unknown key; did you mean seeds?"),
        ({"sensing": {"chanel": {}}}, "sensing.chanel: unknown key; did you mean channel?"),
        ({"seeds": {"first": 5, "last": 4}}, "seeds: last (4) is below first (5)"),
        ({"seeds": {"first": -1}}, "seeds.first: must be at least 0, not -1"),
        ({"traffic": {"duration_s": "long"}}, "traffic.duration_s: must be a number, not 'long'"),
        ({"sensing": {"channel": {"snr_range_db": [10, 0]}}}, "sensing.channel: snr_range_db 10:0 is no range"),
        ({"scenarios": []}, "scenarios: "),
        ({"selection": {"windows": 0}}, "selection.windows: "),
    ],
)
def test_a_fault_is_one_line_with_the_path_of_the_key(content: dict[str, object], expected: str) -> None:
    with pytest.raises(InputError) as error:
        checked(DatasetStudy, content, "my.toml")
    message = str(error.value)
    assert message.startswith(f"my.toml: {expected}")
    assert "\n" not in message
    assert "pydantic" not in message
