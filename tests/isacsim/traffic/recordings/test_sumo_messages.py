"""SUMO's warnings by kind, and the reason of its refusals."""

from __future__ import annotations

import os
from pathlib import Path

from isac_cosim.isacsim.traffic.recordings.sumo_messages import (
    MOST_KINDS,
    OTHER,
    added_up,
    heard,
    reason_of,
    warnings_in,
)

LOG = """Warning: Route file should be sorted by departure time, ignoring 'v2'!
Warning: Teleporting vehicle 'a'; waited too long (jam), lane='e_0', time=301.00.
Warning: Route file should be sorted by departure time, ignoring 'v3'!
Warning: Cannot read '/home/me/net/poly.xml'
 In file '/home/me/net/poly.xml', at line 3.
Warning: Teleporting vehicle 'b'; waited too long (jam), lane='e_1', time=-7.5.
"""


def test_warnings_are_counted_by_kind_with_the_first_as_example() -> None:
    warnings = warnings_in(LOG.splitlines(), [Path("/home/me/net"), Path("/home/me")])
    assert [(warning.count, warning.example) for warning in warnings] == [
        (2, "Route file should be sorted by departure time, ignoring 'v2'!"),
        (2, "Teleporting vehicle 'a'; waited too long (jam), lane='e_0', time=301.00."),
        (1, "Cannot read 'poly.xml' In file 'poly.xml', at line 3."),
    ]
    assert str(warnings[0]).startswith("SUMO warned 2 times, for example: Route file should be sorted")
    assert str(warnings[2]).startswith("SUMO warned once: Cannot read")


def test_many_kinds_are_counted_together() -> None:
    lines = [f"Warning: kind{'x' * k}" for k in range(MOST_KINDS + 5)]
    warnings = warnings_in(lines)
    assert len(warnings) == MOST_KINDS + 1
    assert (warnings[-1].kind, warnings[-1].count) == (OTHER, 5)


def test_episodes_are_added_up() -> None:
    episodes = [warnings_in(LOG.splitlines()), warnings_in(LOG.splitlines()[2:3])]
    assert [(warning.count, warning.example[:5]) for warning in added_up(episodes)] == [
        (3, "Route"), (2, "Telep"), (1, "Canno"),
    ]  # fmt: skip


def test_the_reason_is_what_sumo_said_or_else_its_exception() -> None:
    said = ["Error: The edge 'x' is not known.", " In file 'r.rou.xml'", "Quitting (on error)."]
    assert reason_of("Process Error", said) == "The edge 'x' is not known. In file 'r.rou.xml'"
    assert reason_of("No such\nroute.", []) == "No such route"


def test_what_others_write_meanwhile_is_not_lost(tmp_path: Path, capfd: object) -> None:
    with heard(tmp_path) as said:
        os.write(2, b"Error: of SUMO\n of its second line\nby a neighbour\n")
    assert said == ["Error: of SUMO", " of its second line", "by a neighbour"]
    assert capfd.readouterr().err == "by a neighbour\n"  # type: ignore[attr-defined]
