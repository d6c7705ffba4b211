"""Safety figures against closed forms, and against SUMO's own device."""

from __future__ import annotations

import numpy as np
import pytest

from isac_cosim.evaluation.closed_loop.safety import Totals, VehicleMotions, driving_of, encroachments, figures
from isac_cosim.labeling.road.straight_road import ScriptedVehicle, straight_road


def rows_of(driving: VehicleMotions, vehicle: str) -> np.ndarray:
    return np.flatnonzero(driving.vehicle == driving.names.index(vehicle))


def test_a_follower_that_closes_in_at_constant_speed_has_the_closed_forms() -> None:
    gap_m, closing_mps = 95.0, 5.0
    recording = straight_road(
        ScriptedVehicle("behind", 25.0, duration_s=15.0),
        ScriptedVehicle("ahead", 20.0, start_m=gap_m + 5.0, duration_s=15.0),
    )
    driving = driving_of(recording)
    rows = rows_of(driving, "behind")
    left_m = gap_m - closing_mps * driving.time_s[rows]
    np.testing.assert_allclose(driving.ttc_s[rows], left_m / closing_mps, rtol=1e-9)
    np.testing.assert_allclose(driving.drac_mps2[rows], closing_mps**2 / (2 * left_m), rtol=1e-9)
    assert np.isinf(driving.ttc_s[rows_of(driving, "ahead")]).all()
    everything = np.ones(len(driving.time_s), bool)
    measured = figures([Totals.of(driving, encroachments(recording), everything, np.ones(0, bool))])
    # TTC falls by one second a second from 19 s, so nothing is below 3 s within 15 s; the mean speed is 22.5 m/s.
    assert measured["ttc_below_3_s"] == 0.0
    assert (measured["mean_speed_mps"], measured["travel_s_per_km"]) == pytest.approx((22.5, 1000 / 22.5))
    assert measured["drac_highest_mps2"] == pytest.approx(25.0 / (2 * 20.0))


def test_exposure_is_time_below_the_thresholds() -> None:
    recording = straight_road(
        ScriptedVehicle("behind", 30.0, duration_s=9.0), ScriptedVehicle("ahead", 20.0, start_m=105.0, duration_s=9.0)
    )
    driving = driving_of(recording)
    rows = driving.vehicle == driving.names.index("behind")
    measured = Totals.of(driving, encroachments(recording), rows, np.ones(0, bool))
    # The gap of 100 m closes at 10 m/s: TTC is below 3 s for the last two seconds, below 1.5 s for half a second.
    assert measured.ttc_below_3_s == pytest.approx(2.0, abs=0.11)
    assert measured.ttc_below_1_5_s == pytest.approx(0.5, abs=0.11)


def test_braking_is_the_slope_of_the_speed() -> None:
    recording = straight_road(ScriptedVehicle("one", [(0, 30.0), (5, 30.0), (9, 14.0), (20, 14.0)], duration_s=15.0))
    driving = driving_of(recording)
    measured = Totals.of(driving, encroachments(recording), np.ones(len(driving.time_s), bool), np.ones(0, bool))
    assert measured.hardest_braking_mps2 == pytest.approx(4.0, rel=1e-3)


@pytest.mark.parametrize("ahead_m", [15.0, 40.0])
def test_post_encroachment_time_of_a_cut_in(ahead_m: float) -> None:
    slow, fast, length = 20.0, 25.0, 5.0
    recording = straight_road(
        ScriptedVehicle("behind", fast, lateral=3.2, start_m=100.0, duration_s=12.0),
        ScriptedVehicle("cuts_in", slow, lateral=[(2, 0.0), (6, 3.2)], start_m=100.0 + ahead_m + 20.0, duration_s=12.0),
    )
    entries = encroachments(recording)
    assert (entries.entering, entries.behind) == (("cuts_in",), ("behind",))
    (entered,) = entries.time_s
    distance = ahead_m + 20.0 - (fast - slow) * entered
    assert entries.pet_s[0] == pytest.approx(distance / fast - length / slow, abs=0.02)


def test_a_lane_entered_far_ahead_or_without_anyone_behind_is_no_encroachment() -> None:
    alone = ScriptedVehicle("changes", 20.0, lateral=[(2, 0.0), (6, 3.2)], start_m=400.0, duration_s=12.0)
    far = ScriptedVehicle("far", 25.0, lateral=3.2, duration_s=12.0)
    assert len(encroachments(straight_road(alone)).pet_s) == 0
    assert len(encroachments(straight_road(alone, far)).pet_s) == 0


def test_a_vehicle_alongside_has_no_time_to_collision() -> None:
    recording = straight_road(
        ScriptedVehicle("one", 25.0, duration_s=2.0), ScriptedVehicle("beside", 20.0, start_m=3.0, duration_s=2.0)
    )
    driving = driving_of(recording)
    assert np.isinf(driving.ttc_s[rows_of(driving, "one")]).all()
