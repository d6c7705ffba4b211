"""Images of the road: who is where in which colour, whatever the user has configured of matplotlib."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.colors import to_rgb

from isac_cosim.base.arrays import Array
from isac_cosim.evaluation.closed_loop.environment.picture import (
    ADVICE_COLOUR,
    CLOSE_UP_M,
    OTHER_COLOUR,
    SITE_COLOUR,
    TV_COLOUR,
    UV_COLOUR,
    RoadPicture,
)
from isac_cosim.evaluation.closed_loop.mobile_network import Knowledge
from isac_cosim.isacsim.scenarios.lane import Lane
from isac_cosim.isacsim.scenarios.scenario import Scenario, Site
from isac_cosim.isacsim.traffic.recordings.recording import Recording, Track
from isac_cosim.labeling.road.surroundings import Surroundings

LANES = tuple(Lane(f"e_{k}", "e", k, 4.0, 1000.0, np.array([[0.0, 4.0 * k], [1000.0, 4.0 * k]]), ()) for k in range(2))
SCENARIO = Scenario("two", Path("two.net.xml"), (), (), (0.0, 0.0), LANES, (Site("s", 900.0, 30.0, 20.0, 180.0),))
LENGTH_M, WIDTH_M = 8.0, 3.0


def track(name: str, x: float, lane: int) -> Track:
    one = np.array([1.0])
    return Track(
        name, "passenger", LENGTH_M, WIDTH_M, 0, x * one, 4.0 * lane * one, 20.0 * one, np.array([lane]), x * one,
        0.0 * one,
    )  # fmt: skip


def knowledge(*tracks: Track) -> Knowledge:
    """The UV is ahead of the TV in the right lane; the third vehicle is in the left one."""
    recording = Recording("two", 7, 0.01, LANES, {track.vehicle: track for track in tracks})
    empty = np.empty((0, 6, 1))
    return Knowledge(0.0, (), (), (empty, empty), None, Surroundings(recording), {"tv": "uv"}, {})


THREE = knowledge(track("tv", 480.0, 0), track("uv", 520.0, 0), track("other", 500.0, 1))


def near(image: Array, colour: str) -> Array:
    """The pixels of a colour in the close-up, below the whole road and above the legend, as (row, column)."""
    same = (np.abs(image[100:490].astype(int) - np.round(255 * np.array(to_rgb(colour)))) <= 2).all(axis=2)
    return np.argwhere(same)


def test_vehicles_are_drawn_to_scale_where_they_are_by_their_role() -> None:
    image = RoadPicture(SCENARIO).drawn(THREE, ["tv"], {})
    assert image.shape == (540, 960, 3)
    assert image.dtype == np.uint8
    places = {colour: near(image, colour) for colour in (TV_COLOUR, UV_COLOUR, OTHER_COLOUR)}
    pixels_a_m = 0.98 * 960 / CLOSE_UP_M
    for pixels in places.values():
        height, width = pixels.max(axis=0) - pixels.min(axis=0) + 1
        assert width / pixels_a_m == pytest.approx(LENGTH_M, abs=0.5)
        assert height / pixels_a_m == pytest.approx(WIDTH_M, abs=0.5)
    tv, uv, other = (pixels.mean(axis=0) for pixels in places.values())
    assert (uv - tv) / pixels_a_m == pytest.approx([0.0, 40.0], abs=0.3)
    assert (other - tv) / pixels_a_m == pytest.approx([-4.0, 20.0], abs=0.3)
    assert tv[1] == pytest.approx(480, abs=3)  # the vehicle in the first slot is in the middle


def test_sites_and_advised_vehicles_are_shown() -> None:
    picture = RoadPicture(SCENARIO)
    assert not len(near(picture.drawn(THREE, ["tv"], {}), ADVICE_COLOUR))
    advised = picture.drawn(THREE, ["tv"], {"other": "open_gap"})
    assert len(near(advised, ADVICE_COLOUR)) > 50
    assert not len(near(advised, SITE_COLOUR))
    beside = RoadPicture(replace(SCENARIO, sites=(Site("s", 480.0, 20.0, 20.0, 90.0),))).drawn(THREE, ["tv"], {})
    row, column = near(beside, SITE_COLOUR).mean(axis=0) - near(beside, TV_COLOUR).mean(axis=0)
    assert row < 0  # it stands north of the road, and faces east
    assert column > 0


def test_an_empty_road_is_shown() -> None:
    image = RoadPicture(SCENARIO).drawn(knowledge(), [], {})
    assert len(np.unique(image.reshape(-1, 3), axis=0)) > 3


def test_what_the_user_has_configured_does_not_show_and_stays() -> None:
    picture = RoadPicture(SCENARIO)
    expected = picture.drawn(THREE, ["tv"], {"tv": "slow"})
    configured = {"font.size": 30.0, "figure.facecolor": "black", "axes.facecolor": "red", "lines.markersize": 40.0}
    with mpl.rc_context(configured):
        np.testing.assert_array_equal(picture.drawn(THREE, ["tv"], {"tv": "slow"}), expected)
        assert mpl.rcParams["font.size"] == 30.0


def test_a_lane_that_turns_back_or_has_no_extent_is_drawn() -> None:
    shapes = (np.array([[0.0, 0.0], [50.0, 0.0], [0.0, 0.0]]), np.array([[5.0, 5.0], [5.0, 5.0]]))
    odd = tuple(Lane(f"e_{k}", "e", k, 4.0, 100.0, shape, ()) for k, shape in enumerate(shapes))
    image = RoadPicture(replace(SCENARIO, lanes=(*LANES, *odd))).drawn(THREE, ["tv"], {})
    assert len(near(image, TV_COLOUR)) > 0


def test_pyplot_is_not_imported_for_it() -> None:
    """It would choose a window system, and keep every figure."""
    assert "isac_cosim.evaluation.closed_loop.environment.picture" in sys.modules
    source = Path(sys.modules[RoadPicture.__module__].__file__ or "").read_text(encoding="utf-8")
    assert "pyplot" not in source.split('"""', 2)[2]
