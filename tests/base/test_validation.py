"""The messages about wrong settings: our own words, on one line, with the key's path and the nearest right spelling."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Literal

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from pydantic import Field, ValidationError, field_validator

from isac_cosim.base.errors import InputError
from isac_cosim.base.settings import Settings, checked, read_json, read_toml
from isac_cosim.base.validation import first_fault
from isac_cosim.studies.study import Study
from tests.support.mutations import changed

PHRASES = ("Input should", "Value error", "Field required", "Extra inputs", "Invalid JSON", "should have", "pydantic")
"""How pydantic's messages read."""


class Antenna(Settings):
    rows: int = Field(4, ge=1, le=64)
    spacing_m: float = Field(0.5, gt=0, lt=2)
    gain: float = Field(1.0, ge=0.25)
    pattern: Literal["patch", "dipole"] = "patch"
    version: Literal[1] = 1


class Mast(Settings):
    name: str = Field(max_length=8, pattern="^[a-z]*$")
    lit: bool = False
    antennas: tuple[Antenna, ...] = Field((Antenna(),), min_length=1, max_length=2)
    spare: Antenna | None = None
    heights: dict[str, float] = Field(default_factory=dict)
    span_m: tuple[float, float] = (0.0, 1.0)
    nothing: None = None

    @field_validator("span_m")
    @classmethod
    def _ordered(cls, span: tuple[float, float]) -> tuple[float, float]:
        if span[1] < span[0]:
            raise ValueError("ends before it begins")
        return span


FAULTS: dict[str, tuple[dict[str, Any], str]] = {
    "missing": ({}, "name: is missing; give it a value"),
    "whole number": ({"antennas": [{"rows": "many"}]}, "antennas.0.rows: must be a whole number, not 'many'"),
    "fraction": ({"antennas": [{"rows": 1.5}]}, "antennas.0.rows: must be a whole number, not 1.5"),
    "number": ({"spare": {"spacing_m": []}}, "spare.spacing_m: must be a number, not []"),
    "infinite": ({"spare": {"spacing_m": float("inf")}}, "spare.spacing_m: must be a finite number, not inf"),
    "least": ({"spare": {"rows": 0}}, "spare.rows: must be at least 1, not 0"),
    "most": ({"spare": {"rows": 65}}, "spare.rows: must be at most 64, not 65"),
    "more": ({"spare": {"spacing_m": 0}}, "spare.spacing_m: must be more than 0, not 0"),
    "fraction of a bound": ({"antennas": [{"gain": 0.2}]}, "antennas.0.gain: must be at least 0.25, not 0.2"),
    "less": ({"spare": {"spacing_m": 2}}, "spare.spacing_m: must be less than 2, not 2"),
    "choice": ({"spare": {"pattern": "pach"}}, "spare.pattern: unknown value 'pach'; did you mean patch?"),
    "choices": ({"spare": {"pattern": 7}}, "spare.pattern: unknown value 7; choose one of patch, dipole"),
    "only choice": ({"spare": {"version": 2}}, "spare.version: unknown value 2; only 1 is possible"),
    "key": ({"spare": {"spacing": 2}}, "spare.spacing: unknown key; did you mean spacing_m?"),
    "far key": ({"colour": "red"}, "colour: unknown key; remove it or fix its spelling"),
    "entry's key": ({"antennas": [{"row": 2}]}, "antennas.0.row: unknown key; did you mean rows?"),
    "true or false": ({"lit": "perhaps"}, "lit: must be true or false, not 'perhaps'"),
    "text": ({"name": 3}, "name: must be text, not 3"),
    "long text": ({"name": "a" * 9}, "name: must have at most 8 characters, not 'aaaaaaaaa'"),
    "pattern": ({"name": "A"}, "name: must match the pattern ^[a-z]*$, not 'A'"),
    "no table": ({"spare": 3}, "spare: must be a table of keys and values, not 3"),
    "no list": ({"antennas": 3}, "antennas: must be a list, not 3"),
    "short list": ({"antennas": []}, "antennas: must have at least 1 entry, not []"),
    "long list": ({"antennas": [{}, {}, {}]}, "antennas: must have at most 2 entries, not [{}, {}, {}]"),
    "entry": ({"heights": {"a": "high"}}, "heights.a: must be a number, not 'high'"),
    "half a pair": ({"span_m": [1.0]}, "span_m.1: is missing; give it a value"),
    "ours": ({"span_m": [1.0, 0.0]}, "span_m: ends before it begins"),
    "unforeseen": ({"nothing": 3}, "nothing: must be another kind of value, not 3"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_every_kind_of_fault_has_words_of_its_own(fault: str) -> None:
    content, message = FAULTS[fault]
    named = {} if fault == "missing" else {"name": "m"}
    with pytest.raises(InputError) as error:
        checked(Mast, {**named, **content}, "mast.toml")
    assert str(error.value) == f"mast.toml: {message}"


def test_a_fault_of_several_keys_together_needs_no_key(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"^my\.toml: sweep: snr applies to the sites only"):
        checked(Study, {"sweep": {"snr": ["5"], "sensors": ["truth"]}}, "my.toml")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("{", "is not valid JSON"),
        ("[]", "must be a table of keys and values, not []"),
        ('{"name": "m", "lamp": 1}', "lamp: unknown key; remove it or fix its spelling"),
    ],
)
def test_a_damaged_file_of_ours_is_reported_in_the_same_words(tmp_path: Path, content: str, message: str) -> None:
    path = tmp_path / "mast.json"
    assert read_json(Mast, path) is None
    path.write_text(content)
    with pytest.raises(InputError) as error:
        read_json(Mast, path)
    assert str(error.value) == f"{path}: {message}; the file is damaged or was written by another version"


WHOLE = json.loads(Study().model_dump_json())


@settings(max_examples=150, deadline=None)
@given(content=changed(WHOLE))
@example(content={"dataset": {"labels": {"preset": []}}})
def test_no_text_of_pydantic_is_shown(content: dict[str, Any]) -> None:
    """Of studies with values replaced at any level; compared with what pydantic would have said, too."""
    try:
        Study.model_validate(content)
    except ValidationError as error:
        message = first_fault(error, Study)
        theirs = error.errors()[0]
        assert "\n" not in message
        assert message.startswith(" ".join(".".join(map(str, theirs["loc"])).split()))
        if theirs["type"] != "value_error":
            assert theirs["msg"] not in message
        assert not any(phrase in message for phrase in PHRASES)


@settings(max_examples=50, deadline=None)
@given(key=st.sampled_from(sorted(WHOLE["dataset"])), at=st.integers(0, 20))
def test_a_doubled_letter_in_a_key_is_traced_back(key: str, at: int) -> None:
    at = at % len(key)
    misspelt = key[:at] + key[at] + key[at:]
    with pytest.raises(InputError) as error:
        checked(Study, {"dataset": {misspelt: {}}}, "my.toml")
    assert str(error.value) == f"my.toml: dataset.{misspelt}: unknown key; did you mean {key}?"


def test_files_that_are_no_toml_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such study file"):
        read_toml(tmp_path / "none.toml")
    (tmp_path / "bad.toml").write_text("seeds = {")
    with pytest.raises(InputError, match="not a readable TOML file"):
        read_toml(tmp_path / "bad.toml")
    (tmp_path / "binary.toml").write_bytes(b"\xfe\x00\x81")
    with pytest.raises(InputError, match="not a readable TOML file"):
        read_toml(tmp_path / "binary.toml")
    with pytest.raises(InputError, match="not a readable TOML file"):
        read_toml(tmp_path)
