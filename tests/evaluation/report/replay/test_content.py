"""What the replay's page holds: how small it is, and that it says what was given."""

import base64
import json
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from isac_cosim.base.arrays import Array
from isac_cosim.evaluation.report.page import PAGE, write_page
from isac_cosim.evaluation.report.parts import Part
from isac_cosim.evaluation.report.replay.content import (
    AnswersAlong,
    Maneuver,
    Moving,
    Replay,
    VehicleNear,
    at_rate,
    pack,
)

HOSTILE = "</script><script>document.title='taken'</script>"
MANEUVERS = [Maneuver("overtake", 2.6, 4.0)]


def drive(along_mps: float = 30.0, across_m: float = 0.0) -> Array:
    """The states of 5 s at 400 Hz."""
    times = np.arange(2000) / 400
    states = np.zeros((6, 2000))
    states[0], states[1] = 5e4 + along_mps * times, across_m
    return states


def moving(name: str = "toy-1-0", **more: object) -> Moving:
    truth, sensed, uv = (at_rate(drive(across_m=across), 400.0) for across in (0.0, 0.3, 3.2))
    content = {"intention": "overtake", "origin": "natural", "tv_id": "tv", "uv_id": "uv", "start_s": 10.0}
    return Moving(id=name, **content, maneuvers=MANEUVERS, truth=truth, sensed=sensed, uv=uv, **more)  # type: ignore[arg-type]


def replay(*records: Moving, **more: object) -> Replay:
    return Replay("Episode", records or (moving(),), [(3.2, np.array([[0.0, 0.0], [100.0, 0.0]]))], [], **more)  # type: ignore[arg-type]


def unpacked(text: str, middle: list[float], step: float) -> Array:
    numbers = np.frombuffer(base64.b64decode(text), "<i2").reshape(-1, 2)
    return numbers.T * step + np.reshape(middle, (2, 1))


def test_a_record_takes_one_and_a_half_kilobytes() -> None:
    packed = moving().packed()
    assert sum(len(base64.b64decode(packed[name])) for name in ("truth", "sensed", "uv")) == 1500


@given(
    speed=st.floats(-70, 70), shift=st.floats(-1e5, 1e5), across=st.floats(-50, 50)
)  # fmt: skip
def test_places_come_back_to_the_centimetre(speed: float, shift: float, across: float) -> None:
    truth = at_rate(drive(speed, across), 400.0) + np.array([[shift], [-shift]])
    record = Moving("a", "overtake", "natural", "t", "u", 0.0, MANEUVERS, truth, truth + 0.2, truth + 3.0)
    packed = record.packed()
    for name, path in (("truth", truth), ("sensed", truth + 0.2), ("uv", truth + 3.0)):
        assert (
            np.abs(unpacked(packed[name], packed["middle"], packed["step"]) - path).max() <= packed["step"] / 2 + 1e-6
        )
    assert packed["step"] <= 0.012


def test_a_far_vehicle_coarsens_the_steps_and_is_not_cut_off() -> None:
    far = np.array([[5e4 + 2000.0, 5e4 + 2010.0], [900.0, 900.0]])
    packed = moving(others=[VehicleNear("v", "truck", 12.0, 2.5, 0.0, 0.2, far)]).packed()
    assert np.abs(unpacked(packed["others"][0]["places"], packed["middle"], packed["step"]) - far).max() < 0.1


def test_instants_are_those_of_the_rate() -> None:
    states = np.zeros((6, 2000))
    states[0] = np.arange(2000)
    assert at_rate(states, 400.0, 25.0)[0].tolist() == [16.0 * k for k in range(125)]


def test_packed_numbers_are_little_endian() -> None:
    assert base64.b64decode(pack(np.array([[1.0], [-1.0]]), np.zeros(2), 0.01)) == b"\x64\x00\x9c\xff"


def test_what_is_on_the_page_is_what_was_given(tmp_path: Path) -> None:
    answers = AnswersAlong(2.2, 0.04, np.full((70, 6), 1 / 6), "overtake", False)
    shown = replay(moving(answers=answers), classes=["a", "b", "c", "d", "e", "f"])
    write_page("t", [Part("replay", replay=shown)], "o", tmp_path)
    text = (tmp_path / PAGE).read_text()
    embedded = re.search(r'id="replay-data">(.*?)</script>', text, re.DOTALL)
    assert embedded is not None
    assert json.loads(embedded[1]) == json.loads(json.dumps(shown.packed()))


@pytest.mark.parametrize("field", ["id", "intention", "tv_id", "uv_id", "origin", "site", "remark", "title", "kind"])
def test_no_name_ends_the_data_or_becomes_an_element(field: str, tmp_path: Path) -> None:
    fields = {name: HOSTILE for name in (field,) if name in ("intention", "tv_id", "uv_id", "origin")}
    one = moving(HOSTILE if field == "id" else "toy-1-0")
    vehicle = VehicleNear(HOSTILE, HOSTILE, 4.0, 2.0, 0.0, 0.2, np.full((2, 3), 5e4))
    one = Moving(**{**one.__dict__, **fields, "others": [vehicle] if field == "kind" else []})
    shown = Replay(
        HOSTILE if field == "title" else "t", [one], [], [(HOSTILE, 0.0, 0.0, 0.0)] if field == "site" else [],
        remarks=[HOSTILE] if field == "remark" else [],
    )  # fmt: skip
    write_page(shown.title, [Part("replay", replay=shown)], "o", tmp_path)
    text = (tmp_path / PAGE).read_text()
    plain = replay()
    write_page("t", [Part("replay", replay=plain)], "o", tmp_path / "..")
    assert HOSTILE not in text
    assert text.count("<script") == (tmp_path / ".." / PAGE).read_text().count("<script")
