"""Settings of commanded maneuvers: defaults, bounds, messages that name the key, and older studies."""

from collections.abc import Iterator
from typing import Any

import pytest
from pydantic import ValidationError

from isac_cosim.base.errors import InputError
from isac_cosim.base.settings import Settings, checked
from isac_cosim.isacsim.traffic.drivers.settings import ManeuverSettings
from isac_cosim.labeling.generation.settings import DatasetStudy

RATES = [name for name in ManeuverSettings.model_fields if name.endswith("_hour")]


def sections() -> Iterator[tuple[str, Settings]]:
    for name in ManeuverSettings.model_fields:
        value = getattr(ManeuverSettings(), name)
        if isinstance(value, Settings):
            yield name, value


FIELDS = [(section, name, default) for section, settings in sections() for name, default in settings]
RANGES = [(section, name) for section, name, default in FIELDS if isinstance(default, tuple)]
UNITS = ("_m", "_s", "_mps", "_mps2", "_mps3", "_per_s", "_w_per_kg", "_share", "_gain")


def test_every_setting_has_a_unit_a_description_and_a_source() -> None:
    assert len(FIELDS) > 40
    for section, settings in sections():
        for name, field in type(settings).model_fields.items():
            extra = field.json_schema_extra
            assert name.endswith(UNITS), f"{section}.{name}"
            assert field.description, f"{section}.{name}"
            assert isinstance(extra, dict), f"{section}.{name}"
            assert str(extra["source"]).startswith(
                ("chosen: ", "measured: ", "driving experiments: ", "published: ")
            ), f"{section}.{name}"


def study(section: str, name: str, value: Any) -> DatasetStudy:
    return checked(DatasetStudy, {"maneuvers": {section: {name: value}}}, "study.toml")


@pytest.mark.parametrize(("section", "name"), RANGES)
def test_a_wrong_range_is_refused_by_name(section: str, name: str) -> None:
    low, high = getattr(getattr(ManeuverSettings(), section), name)
    assert getattr(getattr(study(section, name, [low, low]).maneuvers, section), name) == (low, low)
    key = rf"study\.toml: maneuvers\.{section}\.{name}: "
    with pytest.raises(InputError, match=key + r"must be a range \[low, high\] with low <= high"):
        study(section, name, [high, low])
    for outside in ([low, 1e6], [-1e6, high]):
        with pytest.raises(InputError, match=key + r"must be a range \[low, high\] between"):
            study(section, name, outside)
    for malformed in (high, [low], [low, high, high], None, "ab"):
        with pytest.raises(InputError, match=key + r"must be a range \[low, high\]$"):
            study(section, name, malformed)
    for malformed in ([low, "fast"], [low, float("nan")], [None, high]):
        with pytest.raises(
            InputError, match=rf"study\.toml: maneuvers\.{section}\.{name}\.[01]: must be a (finite )?number, not "
        ):
            study(section, name, malformed)


@pytest.mark.parametrize(("section", "name"), [(s, n) for s, n, default in FIELDS if not isinstance(default, tuple)])
def test_a_single_value_has_bounds(section: str, name: str) -> None:
    for outside in (-1.0, 1e6):
        with pytest.raises(InputError, match=rf"study\.toml: maneuvers\.{section}\.{name}: "):
            study(section, name, outside)


def test_a_study_stored_before_these_settings_loads_with_the_defaults() -> None:
    stored = DatasetStudy().model_dump(mode="json")
    stored["maneuvers"] = {name: stored["maneuvers"][name] for name in (*RATES, "rest_s", "within_m")}
    assert checked(DatasetStudy, stored, "dataset.json") == DatasetStudy()


def test_stored_settings_come_back_as_they_were() -> None:
    changed = study("hard_brake", "peak_mps2", [5.0, 6.0])
    assert changed != DatasetStudy()
    assert DatasetStudy.model_validate_json(changed.model_dump_json()) == changed


def test_an_unknown_key_is_refused() -> None:
    with pytest.raises(ValidationError, match=r"hard_brake\.peak"):
        ManeuverSettings.model_validate({"hard_brake": {"peak": [5.0, 6.0]}})
