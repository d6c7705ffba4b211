"""Both fusions against the bound, and their covariances against their errors."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError
from scipy import stats

from isac_cosim.isacsim.panels import Panels
from isac_cosim.isacsim.radio.bounds import measured_bound
from isac_cosim.isacsim.radio.waveform import Waveform
from isac_cosim.isacsim.scenarios.scenario import Site, load
from isac_cosim.isacsim.sensing.chain import SensingSettings
from isac_cosim.isacsim.tracking.fusion import Fixes, fuse, position_bound, single_site
from isac_cosim.isacsim.tracking.fusion_methods import FUSION_METHODS, FusionSettings
from isac_cosim.isacsim.tracking.fusion_tdoa_aoa import fuse_eq5

WAVEFORM = Waveform()
CORNERS = [
    Site("a", -100, 20, 25, 135),
    Site("b", 100, -20, 25, 315),
    Site("c", -100, -20, 10, 45),
    Site("d", 100, 20, 25, 225),
]


def drawn(count: int, sites: int, snr_db: float, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, Panels]:
    """True states on the road between the masts, measurements with errors at the bound, their deviations, panels."""
    rng = np.random.default_rng(seed)
    low, high = [-60, -10, -35, -2], [60, 10, 35, 2]
    state = rng.uniform(low, high, (count, 4))
    panels = Panels.of(CORNERS, 0.8).take(np.tile(np.arange(sites), (count, 1)))
    deviation = np.broadcast_to(measured_bound(np.array(10 ** (snr_db / 10)), WAVEFORM), (count, sites, 3))
    return state, panels.measured(state) + deviation * rng.normal(size=deviation.shape), deviation, panels


def normalised(fixes: Fixes, state: np.ndarray) -> np.ndarray:
    error = fixes.state - state
    return np.einsum("na,nab,nb->n", error, np.linalg.inv(fixes.covariance), error)


@pytest.mark.parametrize("sites", [2, 3, 4])
@pytest.mark.parametrize("snr_db", [0, 10])
def test_information_fusion_is_on_the_bound_and_says_how_well(sites: int, snr_db: int) -> None:
    count = 4000
    state, measured, deviation, panels = drawn(count, sites, snr_db, 1)
    fixes = fuse(measured, deviation, np.ones((count, sites), dtype=bool), panels, FusionSettings())
    bound = position_bound(state, measured_bound(np.full((count, sites), 10 ** (snr_db / 10)), WAVEFORM), panels)
    for part in (slice(0, 2), slice(2, 4)):
        error = np.sum((fixes.state - state)[:, part] ** 2, axis=1)
        least = np.trace(bound[:, part, part], axis1=1, axis2=2)
        assert 0.95 < np.sqrt(np.mean(error / least)) < 1.05
    low, high = stats.chi2.ppf([0.005, 0.995], 4 * count) / count
    assert low < normalised(fixes, state).mean() < high


@pytest.mark.parametrize("weights", ["paper", "covariance"])
def test_eq5_is_unbiased_and_its_covariance_is_its_own(weights: str) -> None:
    count = 4000
    state, measured, deviation, panels = drawn(count, 3, 10, 2)
    settings_ = FusionSettings(method="eq5", eq5_weights=weights)
    fixes = fuse_eq5(measured, deviation, np.ones((count, 3), dtype=bool), panels, settings_)
    # Linear in quantities that are not linear in the noise: the band is wider than chi-square alone.
    assert normalised(fixes, state).mean() == pytest.approx(4, rel=0.06)
    error = (fixes.state - state)[:, :2]
    assert np.abs(np.median(error, axis=0)).max() < 0.1 * np.median(np.abs(error))


def test_the_papers_weights_cost_an_order_of_magnitude() -> None:
    count = 2000
    state, measured, deviation, panels = drawn(count, 4, 0, 3)
    used = np.ones((count, 4), dtype=bool)

    def rms(fixes: Fixes) -> float:
        return float(np.sqrt(np.mean((fixes.state - state)[:, :2] ** 2)))

    paper = rms(fuse_eq5(measured, deviation, used, panels, FusionSettings(method="eq5")))
    right = rms(fuse_eq5(measured, deviation, used, panels, FusionSettings(method="eq5", eq5_weights="covariance")))
    best = rms(fuse(measured, deviation, used, panels, FusionSettings()))
    assert paper > 10 * best
    assert best < right < 3 * best


def median_error_m(sites: list[Site], kept: int, **settings_: str) -> float:
    """Median error of positions near the middle of a scenario's sites at 5 dB, by some of them."""
    count = 3000
    rng = np.random.default_rng(5)
    state = rng.uniform([-60, 0, 16, -2], [60, 14.4, 32, 2], (count, 4))
    panels = Panels.of(sites, 0.8).take(np.tile(np.arange(kept), (count, 1)))
    deviation = np.broadcast_to(measured_bound(np.array(10**0.5), WAVEFORM), (count, kept, 3))
    measured = panels.measured(state) + deviation * rng.normal(size=deviation.shape)
    fused = fuse_eq5 if settings_ else fuse
    fixes = fused(measured, deviation, np.ones((count, kept), dtype=bool), panels, FusionSettings(**settings_))
    return float(np.median(np.hypot(*(fixes.state - state)[:, :2].T)))


def test_sites_at_the_corners_of_a_rectangle_make_eq5_nearly_singular() -> None:
    staggered, rectangle = (list(load(name).sites) for name in ("straight_road", "straight_road_rectangle"))
    assert median_error_m(rectangle, 4, method="eq5") > 1.0
    assert median_error_m(staggered, 4, method="eq5") < 0.07
    # Three of the rectangle's sites do better than all four, and so do weights by covariance.
    assert median_error_m(rectangle, 3, method="eq5") < 0.1
    assert median_error_m(rectangle, 4, method="eq5", eq5_weights="covariance") < 0.05
    for sites in (staggered, rectangle):
        assert median_error_m(sites, 4) < 0.03


@pytest.mark.parametrize(("name", "reach_m"), [("straight_road", 135.0), ("straight_road_rectangle", 150.0)])
def test_all_sites_of_the_straight_roads_see_the_stretch_between_them(name: str, reach_m: float) -> None:
    scenario, view = load(name), SensingSettings().view
    across = [lane.shape[0, 1] for lane in scenario.lanes if lane.edge == "road"]
    for site in scenario.sites:
        for y in across:
            along = np.linspace(-reach_m, reach_m, 200)
            bearing = np.degrees(np.arctan2(along - site.x, y - site.y)) - site.azimuth_deg
            assert np.hypot(along - site.x, y - site.y).max() < view.range_m
            assert np.abs((bearing + 180) % 360 - 180).max() < view.half_width_deg


def test_exact_measurements_give_the_exact_state() -> None:
    state, _, deviation, panels = drawn(50, 4, 0, 4)
    measured = panels.measured(state)
    used = np.ones((50, 4), dtype=bool)
    for fixes in (
        fuse(measured, deviation, used, panels, FusionSettings(speed_prior_mps=1e6)),
        fuse_eq5(measured, deviation, used, panels, FusionSettings(method="eq5", speed_prior_mps=1e6)),
    ):
        assert np.abs(fixes.state - state).max() < 1e-4


@settings(max_examples=60, deadline=None)
@given(
    azimuth=st.floats(0, 360),
    height=st.floats(1, 40),
    bearing=st.floats(-60, 60),
    distance=st.floats(10, 400),
)
def test_one_site_knows_the_place_whatever_its_height_and_azimuth(
    azimuth: float, height: float, bearing: float, distance: float
) -> None:
    """Compass bearings are clockwise from +y, and the sine is measured to the right of the azimuth."""
    site = Site("s", 12.0, -7.0, height, azimuth)
    direction = np.radians(azimuth + bearing)
    place = np.array([12 + distance * np.sin(direction), -7 + distance * np.cos(direction)])
    panels = Panels.of([site], 0.8).take(np.array([[0]]))
    measured = panels.measured(np.array([[*place, 0.0, 0.0]]))
    assert measured[0, 0, 1] == pytest.approx(np.hypot(distance, height - 0.8))
    assert np.sign(measured[0, 0, 0]) == pytest.approx(np.sign(bearing), abs=1e-3) or abs(bearing) < 1e-9
    x, y = single_site(measured, panels)
    assert [x[0, 0], y[0, 0]] == pytest.approx(place, abs=1e-6)


def test_echoes_that_are_not_used_do_not_count() -> None:
    _, measured, deviation, panels = drawn(30, 4, 0, 5)
    used = np.ones((30, 4), dtype=bool)
    used[:, 1] = False
    spoiled = measured.copy()
    spoiled[:, 1] = [0.9, 3000.0, 200.0]
    for method, config in ((fuse, FusionSettings()), (fuse_eq5, FusionSettings(method="eq5"))):
        assert np.array_equal(
            method(measured, deviation, used, panels, config).state,
            method(spoiled, deviation, used, panels, config).state,
        )


def test_methods_are_chosen_by_name_and_a_settings_file_keeps_its_keys() -> None:
    assert list(FUSION_METHODS)[:2] == ["information", "eq5"]
    stored = {"method": "eq5", "steps": 3, "eq5_weights": "covariance", "speed_prior_mps": 50.0}
    assert FusionSettings.model_validate(stored).model_dump() == stored
    with pytest.raises(ValidationError, match="unknown fusion method 'eq6': did you mean eq5"):
        FusionSettings(method="eq6")


def test_too_few_echoes_are_flagged_and_nothing_is_nan() -> None:
    _, measured, deviation, panels = drawn(3, 4, 0, 6)
    used = np.array([[False] * 4, [False, True, False, False], [True] * 4])
    joint = fuse(measured, deviation, used, panels, FusionSettings())
    linear = fuse_eq5(measured, deviation, used, panels, FusionSettings(method="eq5"))
    assert joint.valid.tolist() == [False, True, True]
    assert linear.valid.tolist() == [False, False, True]
    for fixes in (joint, linear):
        assert np.isfinite(fixes.state).all()
        assert np.isfinite(fixes.covariance).all()


def test_parallel_lines_of_sight_leave_a_wide_but_finite_covariance() -> None:
    """A vehicle on the line between two masts: its speed across that line is not measured at all."""
    sites = [Site("a", -100, 0, 10.8, 90), Site("b", 100, 0, 10.8, 270)]
    panels = Panels.of(sites, 0.8).take(np.array([[0, 1]]))
    state = np.array([[10.0, 0.0, 25.0, 3.0]])
    deviation = np.broadcast_to(measured_bound(np.array(1.0), WAVEFORM), (1, 2, 3))
    used = np.ones((1, 2), dtype=bool)
    fixes = fuse(panels.measured(state), deviation, used, panels, FusionSettings())
    assert np.isfinite(
        fuse_eq5(panels.measured(state), deviation, used, panels, FusionSettings(method="eq5")).state
    ).all()
    assert fixes.state[0, :3] == pytest.approx(state[0, :3], abs=0.05)
    assert np.sqrt(fixes.covariance[0, 3, 3]) == pytest.approx(60, rel=0.01)
