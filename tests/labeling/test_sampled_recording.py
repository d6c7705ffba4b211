"""Labels of recordings from samples are those of recordings from every step."""

from collections import Counter
from statistics import fmean

import pytest

from isac_cosim.isacsim.scenarios.scenario import load
from isac_cosim.isacsim.traffic.drivers.settings import ManeuverSettings
from isac_cosim.isacsim.traffic.sources.sumo import TrafficSettings, record
from isac_cosim.labeling.detectors.events import label
from isac_cosim.labeling.detectors.settings import LabelSettings
from tests.support.recording_match import Match, conditioned_rms, match_events

BUSY = ManeuverSettings(
    hard_brake_per_vehicle_hour=40.0, swerve_per_vehicle_hour=40.0, left_change_per_vehicle_hour=40.0
)
SEEDS = range(1, 11)


def compared(scenario: str, seed: int, traffic: TrafficSettings, maneuvers: ManeuverSettings) -> tuple[Match, float]:
    """Match the events, and return the rms difference of conditioned positions, m."""
    full, sampled = (
        record(load(scenario), seed, traffic.model_copy(update={"sample_s": sample_s}), maneuvers)
        for sample_s in (0.01, 0.1)
    )
    labels, others = (label(recording, LabelSettings()) for recording in (full, sampled))
    return match_events(labels, others), conditioned_rms(full, sampled)[0]


@pytest.mark.slow
def test_the_labels_are_the_same() -> None:
    match, rms_m = compared("motorway", 2, TrafficSettings(run_in_s=40.0, duration_s=20.0), BUSY)
    assert len(match.events) >= 4
    assert match.matched == match.events
    assert not match.surplus
    assert rms_m < 1e-3


@pytest.mark.slow
@pytest.mark.parametrize("scenario", ["motorway", "ramp_weave", "urban", "city"])
def test_ten_seeds_have_the_same_labels(scenario: str) -> None:
    """At least 99.5 % of the events of all seeds; of no intention is more than that lost, or two events.

    A vehicle that SUMO moves sideways at once, in a junction, may sway otherwise from then on: the motion of one seed
    can differ by some millimetres. With `pytest -s`, the figures of docs/traffic.md are printed.
    """
    events, matched, surplus = Counter[str](), Counter[str](), Counter[str]()
    rms_by_seed_m = []
    for seed in SEEDS:
        match, rms_m = compared(scenario, seed, TrafficSettings(), ManeuverSettings())
        events.update(match.events)
        matched.update(match.matched)
        surplus.update(match.surplus)
        rms_by_seed_m.append(rms_m)
    lost = events - matched
    print(
        f"\n{scenario}: {events.total()} events, {lost.total()} lost, "
        f"{lost['evasive_swerve']} of {events['evasive_swerve']} swerves, "
        f"{surplus.total()} surplus, rms {1e3 * min(rms_by_seed_m):.2g} to {1e3 * max(rms_by_seed_m):.2g} mm"
    )
    assert fmean(rms_m**2 for rms_m in rms_by_seed_m) < 1e-3**2
    assert lost.total() <= 0.005 * events.total(), lost
    assert surplus.total() <= 0.005 * events.total(), surplus
    assert all(number <= max(2.0, 0.005 * events[kind]) for kind, number in lost.items()), lost
