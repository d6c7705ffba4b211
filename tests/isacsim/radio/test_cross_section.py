"""The vehicle's radar cross-section by aspect: values of the standard's table, symmetry and continuity."""

import numpy as np
import pytest

from isac_cosim.isacsim.radio.cross_section import aspect_dbsm, random_mean_db


def at(azimuth_deg: float, zenith_deg: float) -> float:
    return float(aspect_dbsm(np.array(np.radians(azimuth_deg)), np.array(np.radians(zenith_deg))))


def test_each_side_peaks_at_its_centre() -> None:
    """TR 38.901, Table 7.9.2.1-4."""
    peaks = [at(0, 71.75), at(90, 79.7), at(180, 79.65), at(270, 79.7), at(12, 0)]
    assert peaks == pytest.approx([15.52, 20.75, 14.56, 20.75, 21.26])


def test_the_three_aspects_from_a_mast() -> None:
    """From 25 m above and 100 m away, at a zenith angle of 76 degrees: about 14-15, 7.1 and 20.7 dBsm."""
    zenith = np.degrees(np.arctan2(100, 24.2))
    assert at(0, zenith) == pytest.approx(15.52 - 12 * ((zenith - 71.75) / 29.13) ** 2)
    assert at(180, zenith) == pytest.approx(14.4, abs=0.1)
    assert [at(azimuth, zenith) for azimuth in (40, 45, 50, 55, 60)] == pytest.approx([7.1] * 5, abs=0.05)
    assert at(90, zenith) == pytest.approx(20.7, abs=0.1)


def test_half_a_width_from_the_centre_three_decibels_are_gone() -> None:
    assert at(20.27, 71.75) == pytest.approx(15.52 - 3)
    assert at(90 - 13.45, 79.7) == pytest.approx(20.75 - 3)
    assert at(90, 79.7 + 22.21) == pytest.approx(20.75 - 3)


def test_left_and_right_are_alike_and_turns_do_not_count() -> None:
    azimuth, zenith = np.meshgrid(np.linspace(-np.pi, np.pi, 361), np.linspace(0, np.pi, 181))
    pattern = aspect_dbsm(azimuth, zenith)
    np.testing.assert_allclose(pattern, aspect_dbsm(-azimuth, zenith), atol=0.02)
    np.testing.assert_allclose(pattern, aspect_dbsm(azimuth + 4 * np.pi, zenith), atol=0.02)
    assert pattern.min() == pytest.approx(7.06, abs=0.01)


def test_it_has_no_steps() -> None:
    """The lobes fall by at most 0.95 dB a degree around the vehicle and 1.44 dB a degree on its roof."""
    for zenith in (29.95, 60.0, 76.0, 90.0):
        around = aspect_dbsm(np.radians(np.arange(0, 360, 0.1)), np.full(3600, np.radians(zenith)))
        assert np.abs(np.diff(around)).max() < 0.11
    over = aspect_dbsm(np.zeros(1800), np.radians(np.arange(0, 180, 0.1)))
    assert np.abs(np.diff(over)).max() < 0.16


def test_the_log_normal_mean() -> None:
    draws = random_mean_db(3.41) + 3.41 * np.random.default_rng(1).standard_normal(1_000_000)
    assert (10 ** (draws / 10)).mean() == pytest.approx(1, abs=0.005)
