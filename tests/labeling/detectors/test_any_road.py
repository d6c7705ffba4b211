"""The same driving gives the same events on any road, wherever it is, bends, and is cut into edges and lanes."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from isac_cosim.isacsim.traffic.recordings.recording import Recording
from isac_cosim.labeling.detectors.events import label
from isac_cosim.labeling.detectors.settings import LabelSettings
from isac_cosim.labeling.intentions import Intention
from tests.support.drives import WIDTH_M, Drive, Road, Stretch, ramps, record, sweep, total

BRAKES = ramps((0, 30), (20, 30), (22, 18), (30, 18), (33, 29), (99, 29))
OVERTAKES = total(sweep(12.0, 4.0, WIDTH_M), sweep(24.0, 4.0, -WIDTH_M))
SWERVES = total(WIDTH_M, sweep(20.0, 1.2, 1.2), sweep(21.5, 1.2, -1.2))
DRIVES = (
    Drive("tv", 0.0, 32.0, OVERTAKES, 50.0),
    Drive("uv", 110.0, 24.0, 0.0, 50.0),
    Drive("brakes", 400.0, BRAKES, duration_s=50.0),
    Drive("evades", 700.0, 30.0, SWERVES, 50.0),
    Drive("follows", 640.0, 30.0, 2 * WIDTH_M, 50.0),
    Drive("leads", 690.0, 30.0, lambda t: 2 * WIDTH_M + sweep(30.0, 4.0, -WIDTH_M)(t), 50.0),
    Drive("weaves_in_its_lane", 900.0, 30.0, lambda t: 0.9 * np.sin(0.8 * t), 50.0),
)
CUTS = st.lists(
    st.tuples(st.sampled_from([0.4, 7.0, 60.0, 250.0]), st.integers(0, 1), st.integers(0, 1)), min_size=1, max_size=6
)
"""For each edge: its length, m, and its number of lanes to the right and to the left of the three that are driven."""


def labelled(recording: Recording) -> tuple[list[tuple[str, Intention, str | None]], np.ndarray]:
    """The events by vehicle and onset: vehicle, intention and other; and the three times, s, and the peak, m/s2."""
    events = sorted(
        label(recording, LabelSettings()).events, key=lambda event: (event.vehicle, event.intention, event.onset)
    )
    numbers = np.array([(event.onset, event.commit, event.end, event.peak) for event in events])
    return [(event.vehicle, event.intention, event.other) for event in events], numbers


PLAIN, PLAIN_NUMBERS = labelled(record(Road(), *DRIVES))


def test_on_a_straight_road_of_one_edge_every_maneuver_is_found_once() -> None:
    maneuvers = {(vehicle, intention.text) for vehicle, intention, _ in PLAIN if intention is not Intention.FOLLOWING}
    assert maneuvers == {
        ("tv", "overtake"), ("tv", "right_lane_change"), ("brakes", "hard_brake"), ("brakes", "hard_accel"),
        ("evades", "evasive_swerve"), ("leads", "right_lane_change"),
    }  # fmt: skip


@given(
    cuts=CUTS,
    joints=st.sampled_from([0.0, 0.3, 6.0, 20.0]),
    curvature=st.integers(-10, 10).map(lambda k: k / 2000.0),
    heading=st.floats(-3.1, 3.1),
    origin=st.tuples(st.floats(-1e4, 1e4), st.floats(-1e4, 1e4)),
)
@settings(max_examples=30, deadline=None)
def test_the_same_driving_gives_the_same_events_on_any_road(
    cuts: list[tuple[float, int, int]], joints: float, curvature: float, heading: float, origin: tuple[float, float]
) -> None:
    """Roads turned, shifted, bent, cut into edges with or without junction lanes, with lanes that begin and end."""
    stretches = []
    for length, right, left in [*cuts, *cuts, (6000.0, 0, 0)]:
        stretches.append(Stretch(length, tuple(range(-right, 3 + left))))
        if joints:
            stretches.append(Stretch(joints, (0, 1, 2), internal=True))
    events, numbers = labelled(record(Road(tuple(stretches), curvature, heading, origin), *DRIVES))
    assert events == PLAIN
    assert numbers == pytest.approx(PLAIN_NUMBERS, abs=0.05)
