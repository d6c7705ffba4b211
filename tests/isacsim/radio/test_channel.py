"""SNR by number, range and link budget; rain and vehicles in between."""

import numpy as np
import pytest
from pydantic import ValidationError

from isac_cosim.base.errors import InputError
from isac_cosim.isacsim.panels import Panels
from isac_cosim.isacsim.radio.blockage import TRUCK_HEIGHT_M, Blockers, blockage_db, blockers_of, mean_loss_db
from isac_cosim.isacsim.radio.channel import (
    ChannelSettings,
    EchoGeometry,
    LinkBudget,
    cross_section_dbsm,
    link_snr_db,
    rain_db_per_km,
    snr_db,
)
from isac_cosim.isacsim.radio.cross_section import aspect_dbsm
from isac_cosim.isacsim.radio.waveform import Waveform
from isac_cosim.isacsim.scenarios.lane import Lane
from isac_cosim.isacsim.scenarios.scenario import Site
from isac_cosim.isacsim.traffic.motion import MotionSettings, states
from isac_cosim.isacsim.traffic.recordings.recording import Recording, Track

WAVEFORM = Waveform()
SITES = [Site("a", 0.0, 0.0, 25.0, 90.0), Site("b", 300.0, 0.0, 25.0, 270.0)]


def levels(settings: ChannelSettings, key: tuple, position: np.ndarray, blockers: Blockers | None = None) -> np.ndarray:
    number = np.tile([0, 1], (len(position), 1))
    panels = Panels.of(SITES, 0.8).take(number)
    # All vehicles of these tests drive along +x.
    geometry = EchoGeometry(position, np.zeros(len(position)), number, panels, np.arange(len(position)) / 100)
    return snr_db(settings, WAVEFORM, geometry, blockers, key)


ROAD = np.stack([np.linspace(100, 120, 50), np.zeros(50)], axis=1)


def test_link_budget_figures() -> None:
    """Against the radar equation in linear units: power over kTB F at each element."""
    distance = np.array([50.0, 100.0, 200.0])
    wavelength = 299_792_458 / 3.5e9
    gain = 10 ** ((8 + 8 - 3) / 10)
    received = 10 ** (29.8 / 10) * 1e-3 * gain * wavelength**2 * 10 / ((4 * np.pi) ** 3 * distance**4)
    noise = 1.380649e-23 * 290 * 128 * 30e3 * 10**0.5
    level = link_snr_db(LinkBudget(), WAVEFORM, distance, 10.0)
    assert level == pytest.approx(10 * np.log10(received / noise), abs=0.01)
    assert level == pytest.approx([33.7, 21.6, 9.6], abs=0.06)


def test_rain_figures() -> None:
    """The tables of P.838-3 at 3.5 GHz (by its formula) and 77 GHz, and two further rows of its table 5."""
    assert rain_db_per_km(3.5e9, 1) == pytest.approx(1.155e-4, rel=1e-3)
    assert rain_db_per_km(77e9, 1) == pytest.approx(1.132, rel=1e-3)
    assert rain_db_per_km(10e9, 1) == pytest.approx(0.01217, rel=1e-3)
    assert rain_db_per_km(10e9, 10) == pytest.approx(0.01217 * 10**1.2571, rel=1e-3)
    assert rain_db_per_km(77e9, 50) == pytest.approx(18.8, rel=0.01)


def test_uniform_is_one_draw_a_record() -> None:
    settings = ChannelSettings()
    draws = [levels(settings, ("r", k), ROAD) for k in range(400)]
    assert all(np.ptp(d) == 0 for d in draws)
    values = np.array([d[0, 0] for d in draws])
    assert 0 <= values.min() < 0.5
    assert 9.5 < values.max() <= 10
    assert values.mean() == pytest.approx(5, abs=0.5)
    assert np.array_equal(levels(settings, ("r", 1), ROAD), draws[1])


def test_link_falls_with_the_fourth_power_and_spreads_by_site() -> None:
    settings = ChannelSettings(kind="link", link=LinkBudget(cross_section="constant"))
    level = np.stack([levels(settings, (k,), ROAD)[:, 0] for k in range(300)])
    distance = np.sqrt(ROAD[[0, -1], 0] ** 2 + 24.2**2)
    assert level[:, 0] - level[:, -1] == pytest.approx(np.full(300, 40 * np.log10(distance[1] / distance[0])))
    assert level[:, 0].std() == pytest.approx(3.41, rel=0.15)


def section(heading: float, link: LinkBudget, key: tuple = (0,)) -> np.ndarray:
    """Cross-sections that site a, 25 m high at the origin, sees of a vehicle on ROAD with a constant heading."""
    number = np.zeros((len(ROAD), 1), dtype=int)
    panels = Panels.of(SITES, 0.8).take(number)
    geometry = EchoGeometry(ROAD, np.full(len(ROAD), heading), number, panels, np.arange(len(ROAD)) / 100)
    return cross_section_dbsm(link, geometry, key)[:, 0]


def test_the_cross_section_follows_the_aspect_over_a_record() -> None:
    plain = LinkBudget(cross_section_sd_db=0.0)
    zenith = np.arctan2(ROAD[:, 0], 24.2)
    # The panel stands behind a vehicle that drives along +x, ahead of one along -x, left of one along -y.
    for heading, azimuth in ((0.0, np.pi), (np.pi, 0.0), (-np.pi / 2, -np.pi / 2), (np.pi / 2, np.pi / 2)):
        assert section(heading, plain) == pytest.approx(aspect_dbsm(np.array(azimuth), zenith))
    assert np.ptp(section(np.pi, plain)) > 0.1
    assert section(0.0, LinkBudget(cross_section="constant", cross_section_sd_db=0.0)) == pytest.approx(11.25)
    # A vehicle that never moves has no heading.
    assert section(np.nan, plain) == pytest.approx(11.25)


@pytest.mark.parametrize("kind", ["aspect", "constant"])
def test_the_random_part_has_unit_linear_mean(kind: str) -> None:
    link = LinkBudget(cross_section=kind)
    still = link.model_copy(update={"cross_section_sd_db": 0.0})
    random = np.array([section(0.3, link, (k,))[0] for k in range(20_000)]) - section(0.3, still)[0]
    assert random.std() == pytest.approx(3.41, rel=0.02)
    # Its linear standard deviation is 0.92, of the mean of 20,000 draws 0.0065.
    assert (10 ** (random / 10)).mean() == pytest.approx(1, abs=0.025)


def test_rain_takes_both_ways() -> None:
    dry = levels(ChannelSettings(kind="fixed"), (0,), ROAD)
    wet = levels(ChannelSettings(kind="fixed", rain_mm_per_h=100), (0,), ROAD)
    distance = np.hypot(ROAD[:, 0], 24.2)
    assert (dry - wet)[:, 0] == pytest.approx(2 * distance / 1000 * rain_db_per_km(3.5e9, 100))


def truck(x: float, y: float = 0.0, heading: tuple[float, float] = (1.0, 0.0)) -> Blockers:
    """One truck of 12 m standing with its front bumper at (x, y)."""
    return Blockers(
        ["t"],
        0.01,
        np.full((1, 50), x),
        np.full((1, 50), y),
        np.tile(heading, (1, 50, 1)).astype(float),
        np.array([12.0]),
        np.array([2.5]),
        np.array([TRUCK_HEIGHT_M]),
    )


def hidden(blockers: Blockers, x: float, y: float = 0.0) -> list[bool]:
    number = np.array([[0, 1]])
    panels = Panels.of(SITES, 0.8).take(number)
    loss = np.stack(
        [blockage_db(blockers, np.array([[x, y]]), number, panels, np.zeros(1), (k,))[0] for k in range(20)]
    )
    return list((loss > 0).any(axis=0))


def test_a_truck_hides_what_is_close_behind_it_from_a_mast() -> None:
    # From 25 m at the target 105 m away the line is below 3 m for the last 105 * 2.2 / 24.2 = 9.5 m.
    assert hidden(truck(100.0), 105.0) == [True, False]
    assert hidden(truck(100.0), 112.0) == [False, False]
    assert hidden(truck(117.0), 104.0) == [False, True]
    assert hidden(truck(100.0, y=4.0), 105.0) == [False, False]
    # Across the road its side hides as well.
    assert hidden(truck(100.0, y=6.0, heading=(0.0, 1.0)), 105.0) == [True, False]


def test_blockers_come_from_a_recording() -> None:
    lane = Lane("l", "e", 0, 3.2, 200.0, np.array([[0.0, 0.0], [100.0, 0.0], [100.0, 100.0]]), ())

    def moving(name: str, kind: str, first: int, place: np.ndarray) -> Track:
        x, y = np.minimum(place, 100.0), np.maximum(place - 100.0, 0.0)
        still = np.zeros(len(place))
        return Track(name, kind, 8.0, 2.5, first, x, y, still + 20, still.astype(np.int32), place, still)

    place = np.linspace(80, 120, 201)
    tracks = {
        "early": moving("early", "passenger", 0, place[:50]),
        "truck": moving("truck", "truck", 100, place),
        "car": moving("car", "passenger", 150, place),
        "tv": moving("tv", "passenger", 100, place),
    }
    recording = Recording("r", 1, 0.01, (lane,), tracks)
    as_it_is = MotionSettings(max_shift_m=0.0)
    others = blockers_of(recording, 1.0, 3.0, {"tv"}, as_it_is, every_steps=10)
    assert others.ids == ("truck", "car")
    assert others.step_s == pytest.approx(0.1)
    assert others.height_m.tolist() == [3.0, 1.6]
    assert others.x[0, :3] == pytest.approx([80, 82, 84])
    assert np.isnan(others.x[1, :5]).all()
    assert others.x[1, 5] == pytest.approx(80)
    assert others.heading[0, 0] == pytest.approx([1, 0])
    assert others.heading[0, -1] == pytest.approx([0, 1])
    # On the rounded road they are where the target would be in their place.
    rounded = blockers_of(recording, 1.0, 3.0, {"tv"}, MotionSettings(), every_steps=10)
    times = np.linspace(1.0, 3.0, 21)
    expected = states(recording, tracks["truck"], times, MotionSettings())[:2]
    np.testing.assert_allclose([rounded.x[0], rounded.y[0]], expected, atol=1e-9)
    assert 0.2 < np.hypot(rounded.x - others.x, rounded.y - others.y)[0].max() < 1.2
    # Absent vehicles hide nothing, and numpy does not complain about them.
    with np.errstate(all="raise"):
        number = np.array([[0, 1]])
        panels = Panels.of(SITES, 0.8).take(number)
        assert not blockage_db(others, np.array([[50.0, 30.0]]), number, panels, np.zeros(1), (0,)).any()


def test_losses_are_those_of_the_table() -> None:
    distance = np.array([100.0, 1000.0, 1000.0])
    mean, deviation = mean_loss_db(distance, np.array([0.8, 0.8, 4.0]), np.array([25.0, 1.0, 25.0]), 3.0)
    assert mean == pytest.approx([5.0, 9 + 15 * 3 - 41, 0.0])
    assert deviation == pytest.approx([4.0, 4.5, 0.0])


def test_a_loss_is_drawn_once_a_record_and_counts_twice() -> None:
    position = np.tile([105.0, 0.0], (50, 1))
    settings = ChannelSettings(kind="fixed", snr_db=20, blockage=True)
    loss = np.array([20 - levels(settings, (k,), position, truck(100.0)) for k in range(400)])
    assert np.all(loss[:, :, 0] == loss[:, :1, 0])
    assert np.all(loss[:, :, 1] == 0)
    clipped = np.maximum(np.random.default_rng(0).normal(5, 4, 100_000), 0)
    assert loss[:, 0, 0].mean() / 2 == pytest.approx(clipped.mean(), rel=0.1)


def test_wrong_settings_are_refused() -> None:
    with pytest.raises(ValidationError, match="LOW <= HIGH"):
        ChannelSettings(snr_range_db=(10, 0))
    with pytest.raises(InputError, match="blockage"):
        levels(ChannelSettings(blockage=True), (0,), ROAD)
