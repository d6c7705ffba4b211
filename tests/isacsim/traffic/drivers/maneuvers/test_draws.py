"""What is drawn for each maneuver follows the law that its settings state, and nothing is drawn without an occasion."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, cast

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from isac_cosim.isacsim.traffic.drivers.handling.driver_view import DriverView
from isac_cosim.isacsim.traffic.drivers.handling.hazards import Debris, VehicleAhead
from isac_cosim.isacsim.traffic.drivers.maneuvers.debris import draw_debris
from isac_cosim.isacsim.traffic.drivers.maneuvers.evasion import draw_answer, draw_debris_evasion
from isac_cosim.isacsim.traffic.drivers.maneuvers.kinds import Kind, ManeuverCommand, Occasion
from isac_cosim.isacsim.traffic.drivers.settings import KINDS, ManeuverSettings

SETTINGS = ManeuverSettings()
KIND = {kind.name: kind for kind in KINDS}
DRAWS = 2000
LEAST_P = 1e-4
"""Of a Kolmogorov-Smirnov test on draws of a fixed seed."""


class Surroundings:
    """A car at 20 m/s behind another at 18 m/s, with free lanes on both sides, unless told otherwise."""

    def __init__(self, **changes: Any) -> None:
        self.vehicle, self.leader = "a", "b"
        self.speed, self.leader_speed, self.allowed_speed, self.gap_m = 20.0, 18.0, 25.0, 46.0
        self.is_car, self.lane_width_m, self.width_m = True, 3.6, 1.8
        self.is_steady, self.lateral_m = True, 0.0
        self.lane, self.lane_position_m, self.lane_left_m = "e_1", 100.0, 900.0
        self.stands, self.room = True, {1: True, -1: True}
        self.beside = {1: 40.0, -1: 12.0}
        self.lanes = {1: True, -1: True}
        self.__dict__.update(changes)

    def has_lane(self, direction: int, stay_s: float) -> bool:
        return bool(self.lanes[direction]) and stay_s == SETTINGS.stay_s

    def has_room_beside(self, direction: int, clear_m: float, ahead_s: float) -> bool:
        return bool(self.room[direction])

    def stands_at_light(self, distance_m: float) -> bool:
        return self.stands and distance_m == SETTINGS.brisk_start.within_m

    def gap_beside_m(self, direction: int) -> float:
        return float(self.beside[direction])


def view(**changes: Any) -> DriverView:
    return cast(DriverView, Surroundings(**changes))


def occasion(rng: np.random.Generator, ends: bool = False, lefthand: bool = False, **changes: Any) -> Occasion:
    return Occasion(view(**changes), rng, 10.0, lefthand, ends, {"c"}, lambda debris, seen_by: None)


FAST: dict[str, Any] = {"gap_m": 500.0, "allowed_speed": 60.0, "leader": None}
"""Surroundings that do not limit an acceleration."""


def commands(name: str, settings: ManeuverSettings = SETTINGS, number: int = DRAWS, **changes: Any) -> list[Any]:
    """Commands of a kind, drawn one after the other."""
    rng = np.random.default_rng(1)
    drawn = [KIND[name].draw(occasion(rng, **changes), settings) for _ in range(number)]
    assert None not in drawn
    return drawn


Law = Callable[[tuple[float, float]], Any]


def uniform(ends: tuple[float, float]) -> Any:
    return stats.uniform(ends[0], ends[1] - ends[0])


def falling(ends: tuple[float, float]) -> Any:
    """The smaller the likelier, linearly down to the upper end."""
    return stats.triang(0.0, ends[0], ends[1] - ends[0])


LAWS: list[tuple[str, str, Law]] = [
    ("hard_brake", "peak_mps2", falling),
    ("hard_brake", "rise_s", lambda ends: stats.loguniform(*ends)),
    ("hard_brake", "drop_mps", uniform),
    ("hard_accel", "peak_mps2", uniform),
    ("hard_accel", "power_w_per_kg", uniform),
    ("hard_accel", "headway_s", uniform),
    ("brisk_start", "peak_mps2", uniform),
    ("brisk_start", "lasts_s", uniform),
    ("overtake", "clearance_m", uniform),
    ("swerve", "peak_mps2", uniform),
    ("swerve", "hold_s", uniform),
    ("slow_vehicle", "speed_share", uniform),
    ("slow_vehicle", "slow_s", uniform),
    ("stop_in_lane", "stand_s", uniform),
]
"""A setting of a section, which a command's attribute of the same name is drawn from, and by which law."""


@pytest.mark.parametrize(("name", "setting", "law"), LAWS, ids=[f"{row[0]}.{row[1]}" for row in LAWS])
@pytest.mark.parametrize("narrow", [False, True], ids=["default", "narrowed"])
def test_values_have_the_law_of_their_setting(name: str, setting: str, law: Law, narrow: bool) -> None:
    section = getattr(SETTINGS, name)
    low, high = getattr(section, setting)
    ends = (low + (high - low) / 4, high - (high - low) / 4) if narrow else (low, high)
    settings = SETTINGS.model_copy(update={name: section.model_copy(update={setting: ends})})
    values = [getattr(command, setting) for command in commands(name, settings, **(FAST if "accel" in name else {}))]
    assert ends[0] <= min(values) < max(values) <= ends[1]
    assert stats.kstest(values, law(ends).cdf).pvalue > LEAST_P


def test_what_is_drawn_for_one_command_is_independent() -> None:
    brakes = commands("hard_brake")
    columns = [[getattr(brake, name) for brake in brakes] for name in ("peak_mps2", "rise_s", "drop_mps")]
    columns.append([brake.driver.reaction_s for brake in brakes])
    correlation = np.abs(stats.spearmanr(np.array(columns).T).statistic - np.eye(4))
    assert correlation.max() < 4.0 / math.sqrt(DRAWS)


def test_derived_goals_keep_their_laws_and_limits() -> None:
    """The goal of an acceleration is a gain above the speed, as far as the driver's impatience and the leader allow."""
    gains = [surge.goal_mps - 20.0 for surge in commands("hard_accel", **FAST)]
    assert stats.kstest(gains, uniform(SETTINGS.hard_accel.gain_mps).cdf).pvalue > LEAST_P
    impatient = commands("hard_accel", gap_m=500.0, allowed_speed=25.0, leader=None, speed=19.0)
    assert max(surge.goal_mps for surge in impatient) <= 25.0 * SETTINGS.hard_accel.impatience_gain[1]
    for surge in commands("hard_accel", gap_m=150.0, allowed_speed=60.0, leader_speed=22.0):
        room = 150.0 - 3.0 - surge.headway_s * 20.0
        assert surge.goal_mps <= 22.0 + math.sqrt(2.0 * 1.5 * room) + 1e-9
    surplus = np.array([25.0 * command.speed_gain - 18.0 for command in commands("overtake")])
    low, high = SETTINGS.overtake.surplus_mps
    # The desired speed never falls: a surplus that is less than what the driver wants already makes no difference.
    assert surplus.min() == pytest.approx(max(low, 7.0))
    assert (surplus > 7.0 + 1e-9).mean() == pytest.approx((high - 7.0) / (high - low), abs=0.05)


@pytest.mark.parametrize("width_m", [3.6, 3.2, 2.6])
def test_a_swerve_stays_in_its_lane_on_either_side(width_m: float) -> None:
    low, high = SETTINGS.swerve.offset_m
    largest = min(high, width_m / 2.0 - SETTINGS.evasion.lane_margin_m)
    offsets = np.array([command.offset_m for command in commands("swerve", lane_width_m=width_m)])
    assert stats.kstest(np.abs(offsets), uniform((min(low, largest), largest)).cdf).pvalue > LEAST_P
    assert 0.45 < (offsets > 0).mean() < 0.55
    one_sided = commands("swerve", number=50, room={1: True, -1: False})
    assert all(command.offset_m > 0 for command in one_sided)


@given(st.data())
def test_a_draw_never_leaves_its_range(data: st.DataObject) -> None:
    """Also ranges of a single value, and rise times from zero on, which have no logarithm."""

    def ends(most: float) -> tuple[float, float]:
        low, high = sorted(data.draw(st.tuples(st.floats(0.5, most), st.floats(0.5, most))))
        return low, high

    peak, drop, rise = ends(10.0), ends(40.0), (0.0, data.draw(st.floats(0.0, 10.0)))
    brake = SETTINGS.hard_brake.model_copy(update={"peak_mps2": peak, "drop_mps": drop, "rise_s": rise})
    for command in commands("hard_brake", SETTINGS.model_copy(update={"hard_brake": brake}), number=5):
        assert peak[0] <= command.peak_mps2 <= peak[1]
        assert drop[0] <= command.drop_mps <= drop[1]
        assert 0.0 <= command.rise_s <= max(rise[1], 0.05) * (1.0 + 1e-12)


@pytest.mark.parametrize("kind", KINDS, ids=[kind.name for kind in KINDS])
def test_a_seed_means_the_same_commands(kind: Kind) -> None:
    def drawn(seed: int) -> list[str]:
        rng = np.random.default_rng(seed)
        around = {"beside": {1: 12.0, -1: 12.0}, "leader_speed": 22.0}
        made = [kind.draw(occasion(rng, **around), SETTINGS) for _ in range(3)]
        return [repr({k: v for k, v in vars(command).items() if k != "rng"}) if command else "" for command in made]

    assert drawn(1) == drawn(1)
    if kind.name not in ("left_change", "right_change", "cut_in"):  # they draw nothing
        assert drawn(1) != drawn(2)


def test_the_order_of_the_kinds_is_part_of_what_a_seed_means() -> None:
    """An inserted kind would change every recording; a new one comes last."""
    names = [kind.name for kind in KINDS][:12]
    assert names[:5] == ["debris", "surge", "brisk_start", "hard_brake", "hard_accel"]
    assert names[5:9] == ["left_change", "right_change", "overtake", "swerve"]
    assert names[9:] == ["slow_vehicle", "stop_in_lane", "cut_in"]
    assert {kind.rate for kind in KINDS} == {name for name in ManeuverSettings.model_fields if "_per_vehicle_" in name}


NO_LANE, NO_ROOM = {"lanes": {1: False, -1: False}}, {"room": {1: False, -1: False}}
NO_OCCASION: list[tuple[str, dict[str, Any]]] = [
    ("hard_brake", {"speed": 14.0}),
    *[(name, changes) for name in ("surge", "hard_accel") for changes in ({"speed": 5.0}, {"is_car": False})],
    ("surge", {"leader": None}),
    ("hard_accel", {"gap_m": 10.0}),
    ("hard_accel", {"allowed_speed": 19.0}),
    ("brisk_start", {"stands": False}),
    ("brisk_start", {"is_car": False}),
    ("debris", {"speed": 8.0}),
    ("debris", {"lane_left_m": 30.0}),
    ("debris", {"gap_m": 15.0}),
    ("debris", {"is_steady": False}),
    *[(name, changes) for name in ("left_change", "right_change") for changes in (NO_LANE, NO_ROOM)],
    *[("overtake", changes) for changes in ({"leader": None}, {"leader": "c"}, {"is_car": False}, NO_LANE)],
    *[("overtake", changes) for changes in ({"gap_m": 16.0}, {"gap_m": 50.0}, {"leader_speed": 30.0})],
    *[("swerve", changes) for changes in ({"speed": 10.0}, {"is_car": False}, {"is_steady": False}, NO_ROOM)],
    ("slow_vehicle", {"speed": 15.0}),
    *[("cut_in", changes) for changes in ({"speed": 8.0}, NO_LANE, {"beside": {1: 40.0, -1: 40.0}})],
]


@pytest.mark.parametrize(("name", "changes"), NO_OCCASION, ids=[f"{name} {next(iter(c))}" for name, c in NO_OCCASION])
def test_without_an_occasion_there_is_no_command(name: str, changes: dict[str, Any]) -> None:
    """Each just beyond one of its limits."""
    rng = np.random.default_rng(1)
    assert all(KIND[name].draw(occasion(rng, **changes), SETTINGS) is None for _ in range(20))


@pytest.mark.parametrize(("lefthand", "left"), [(False, 1), (True, -1)])
def test_left_is_the_faster_side_where_traffic_keeps_right(lefthand: bool, left: int) -> None:
    for name, side in (("left_change", left), ("right_change", -left)):
        (command,) = commands(name, number=1, lefthand=lefthand)
        assert (command.direction, command.patience_s) == (side, SETTINGS.lane_change.patience_s)
    anywhere = SETTINGS.lane_change.model_copy(update={"clear_s": 0.0})
    commands("left_change", SETTINGS.model_copy(update={"lane_change": anywhere}), number=1, **NO_ROOM)


def test_a_cut_in_takes_the_faster_side_where_both_fit() -> None:
    for beside, side in (({1: 12.0, -1: 12.0}, 1), ({1: 40.0, -1: 12.0}, -1)):
        (command,) = commands("cut_in", number=1, beside=beside)
        assert (command.direction, command.startles) == (side, side)


def test_an_acceleration_knows_its_reason() -> None:
    assert commands("surge", number=1, ends=True, **FAST)[0].reason == "merge"
    assert commands("surge", number=1, **(FAST | {"leader": "b"}))[0].reason == "gap_ahead"
    assert commands("hard_accel", number=1, **FAST)[0].reason == ""


def test_debris_comes_into_view_a_few_seconds_ahead_and_behind_the_leader() -> None:
    rng = np.random.default_rng(4)
    evasion = SETTINGS.evasion
    debris = [one for _ in range(DRAWS) if (one := draw_debris(view(gap_m=500.0), SETTINGS, rng, 10.0))]
    assert len(debris) == DRAWS
    ahead_s = np.array([one.at_m - 100.0 for one in debris]) / 20.0
    lies_s = np.array([one.until for one in debris]) - 10.0 - ahead_s
    for values, ends in (
        (ahead_s, evasion.notice_ttc_s),
        (lies_s, evasion.lies_s),
        ([one.lateral_m for one in debris], evasion.debris_lateral_m),
        ([one.half_width_m for one in debris], evasion.debris_half_width_m),
    ):
        assert stats.kstest(values, uniform(ends).cdf).pvalue > LEAST_P
    hidden = [draw_debris(view(gap_m=46.0), SETTINGS, rng, 10.0) for _ in range(200)]
    assert all(one is not None and one.at_m <= 146.0 for one in hidden)


DEBRIS = Debris("e_1", 160.0, 0.3, 0.4, 20.0)


def test_debris_is_passed_on_the_nearer_side_with_clearance() -> None:
    """It lies 0.3 m to the left: half the car, half of it and the margin to the right, less what is there already."""
    rng, evasion = np.random.default_rng(5), SETTINGS.evasion
    plans = [made.plan for _ in range(DRAWS) if (made := draw_debris_evasion(view(), DEBRIS, SETTINGS, rng))]
    assert len(plans) == DRAWS
    steered = [plan for plan in plans if plan.aside_m]
    margins = [-plan.aside_m - (0.9 + 0.4 - 0.3) for plan in steered if not plan.stays]
    assert stats.kstest(margins, uniform(evasion.margin_m).cdf).pvalue > LEAST_P
    assert {plan.aside_m for plan in steered if plan.stays} == {-3.6}
    assert all(plan.brakes for plan in plans if not plan.aside_m)
    for count, among, share in (
        (len(steered), len(plans), evasion.steer_share),
        (sum(plan.stays for plan in steered), len(steered), evasion.stay_share),
        (sum(plan.brakes for plan in steered), len(steered), evasion.brake_share),
    ):
        assert stats.binomtest(count, among, share).pvalue > LEAST_P
    assert stats.kstest([plan.pass_share for plan in plans], uniform(evasion.pass_share).cdf).pvalue > LEAST_P


@pytest.mark.parametrize(
    ("changes", "asides"),
    [
        ({"room": {1: True, -1: False}}, (1.7, 2.1)),
        ({"room": {1: False, -1: False}}, (0.0, 0.0)),
        ({"is_car": False}, (0.0, 0.0)),
        ({"lanes": {1: False, -1: False}, "lane_width_m": 2.4}, (-1.1, -1.1)),
    ],
)
def test_where_there_is_no_room_drivers_go_elsewhere_or_brake(
    changes: dict[str, Any], asides: tuple[float, float]
) -> None:
    always = SETTINGS.evasion.model_copy(update={"steer_share": 1.0, "stay_share": 0.0})
    rng, settings = np.random.default_rng(6), SETTINGS.model_copy(update={"evasion": always})
    for _ in range(50):
        evasion = draw_debris_evasion(view(**changes), DEBRIS, settings, rng)
        assert evasion is not None
        assert asides[0] - 1e-9 <= evasion.plan.aside_m <= asides[1] + 1e-9
        assert evasion.plan.brakes or evasion.plan.aside_m


def test_an_answer_to_a_vehicle_ahead_always_brakes() -> None:
    rng = np.random.default_rng(7)
    answers = [draw_answer(view(), VehicleAhead("b"), SETTINGS, rng) for _ in range(50)]
    assert all(answer is not None and answer.inattentive and answer.plan.brakes for answer in answers)
    assert {answer.plan.steer_ttc_s for answer in answers if answer is not None} == {SETTINGS.evasion.steer_ttc_s}
    for changes in ({"speed": 8.0}, {"is_steady": False}):
        assert draw_answer(view(**changes), VehicleAhead("b"), SETTINGS, rng) is None


def test_whom_a_command_surprises() -> None:
    """The driver behind one that brakes, and the one beside and behind where somebody cuts in."""
    brake, slow = commands("hard_brake", number=1)[0], commands("slow_vehicle", number=1)[0]
    assert isinstance(brake, ManeuverCommand)
    assert (brake.startles, slow.startles) == (0, None)
    evasions = [draw_debris_evasion(view(), DEBRIS, SETTINGS, np.random.default_rng(k)) for k in range(30)]
    assert all(made is not None and made.startles == (0 if made.plan.brakes else None) for made in evasions)
    (overtake,) = commands("overtake", number=1)
    assert overtake.steers == ("b",)
