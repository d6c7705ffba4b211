"""The heading of a vehicle that drives, stops and drives off."""

import numpy as np
import pytest

from isac_cosim.isacsim.heading import heading_rad


def test_a_driving_vehicle_points_where_it_drives() -> None:
    turn = np.linspace(-3, 3, 50)
    assert heading_rad(20 * np.stack([np.cos(turn), np.sin(turn)])) == pytest.approx(turn)


def test_a_standing_vehicle_keeps_its_direction() -> None:
    velocity = np.array([[0.0, 0.1, 5.0, 0.0, -0.2, -5.0], [0.0, 0.0, 5.0, 0.3, 0.0, 5.0]])
    quarter = np.pi / 4
    assert heading_rad(velocity) == pytest.approx([quarter] * 5 + [3 * quarter])


def test_a_vehicle_that_never_moves_has_none() -> None:
    assert np.isnan(heading_rad(np.full((2, 4), 0.1))).all()
