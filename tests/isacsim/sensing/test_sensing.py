"""The chain composed: accuracy, independence of company and order, and who sees whom."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError
from scipy import stats

from isac_cosim.base.errors import InputError
from isac_cosim.isacsim.panels import Panels
from isac_cosim.isacsim.radio.blockage import TRUCK_HEIGHT_M, Blockers
from isac_cosim.isacsim.radio.bounds import measured_bound
from isac_cosim.isacsim.radio.channel import ChannelSettings
from isac_cosim.isacsim.radio.waveform import Waveform
from isac_cosim.isacsim.scenarios.scenario import Site
from isac_cosim.isacsim.sensing.chain import (
    SensingSettings,
    ViewSettings,
    _heading_rad,
    assign,
    fix,
)
from isac_cosim.isacsim.sensing.following import Approach, before, run_in
from isac_cosim.isacsim.sensing.passages import Passage
from isac_cosim.isacsim.tracking.fusion import position_bound
from isac_cosim.isacsim.tracking.fusion_methods import FusionSettings
from isac_cosim.isacsim.tracking.kalman import TrackingSettings
from tests.support.sensing_road import RATE_HZ, drive, hard_brake, road_sites, sense, swerve

SITES = road_sites()
DEFAULT = SensingSettings()


def errors(truth: np.ndarray, records: list) -> tuple[np.ndarray, np.ndarray]:
    state = np.stack([r.state for r in records])
    fixes = np.stack([r.fixes for r in records])
    return state - truth, fixes - truth[:, :4]


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


@pytest.mark.parametrize("motion", [lambda n, x: drive(n, x, 0.0, 28.0), hard_brake, swerve])
def test_position_within_10_cm_and_the_filter_improves_it(motion) -> None:
    truth = np.stack([motion(2000, 60.0 * k) for k in range(6)])
    records = sense(truth, SITES, DEFAULT, [("accuracy", k) for k in range(6)])
    filtered, raw = errors(truth, records)
    assert all(r.n_sites == 4 and 0 <= r.snr_db <= 10 and r.detected == 1 for r in records)
    assert np.median(np.hypot(raw[:, 0], raw[:, 1])) < 0.1
    assert rms(filtered[:, :2]) < 0.5 * rms(raw[:, :2])
    assert rms(filtered[:, 2:4]) < 0.7 * rms(raw[:, 2:])
    assert rms(filtered[:, 4:]) < 0.8
    # The start is no worse than the rest: the filter has settled before the record begins.
    assert rms(filtered[:, 4:, :40]) < 0.8


@settings(max_examples=8, deadline=None)
@given(order=st.permutations(range(4)), cut=st.integers(1, 3))
def test_a_record_does_not_depend_on_batch_or_order(order: list[int], cut: int) -> None:
    truth = np.stack([drive(80, 150.0 * k, 1.0, 20.0 + k) for k in range(4)])
    keys = [("scenario", 7, k) for k in range(4)]
    reference = sense(truth, SITES, DEFAULT, keys)
    for part in (order[:cut], order[cut:]):
        again = sense(truth[list(part)], SITES, DEFAULT, [keys[k] for k in part])
        for k, record in zip(part, again, strict=True):
            assert np.array_equal(record.state, reference[k].state)
            assert np.array_equal(record.fixes, reference[k].fixes)
            assert record.snr_db == reference[k].snr_db


def test_a_record_does_not_depend_on_how_many_are_filtered_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    truth = [drive(40 + 10 * (k % 3), 150.0 * k, 1.0, 20.0) for k in range(5)]
    keys = [("together", k) for k in range(5)]
    reference = sense(truth, SITES, DEFAULT, keys)
    for most in ("TOGETHER", "MOST_INSTANTS"):
        monkeypatch.setattr(f"isac_cosim.isacsim.sensing.following.{most}", 2)
        again = sense(truth, SITES, DEFAULT, keys)
        assert all(np.array_equal(a.state, b.state) for a, b in zip(reference, again, strict=True))


@pytest.mark.parametrize("snr_db", [-20, 0, 10])
def test_fixes_are_on_the_bound_and_their_covariances_honest(snr_db: float) -> None:
    """Echo to fix, four sites: errors against the bound at the true SNR and against the covariance that comes out."""
    motion = hard_brake(2000)
    level = DEFAULT.model_copy(update={"channel": ChannelSettings(kind="fixed", snr_db=snr_db)})
    panels = Panels.of(SITES, level.target_height_m)
    approach = Approach(motion, run_in=200, before=200, carried=200)
    values, ratios = [], []
    for k in range(3):
        fixes = fix(approach, RATE_HZ, panels, level, ("honest", k)).fixes
        error = fixes.state - motion[:4].T
        values.append(np.einsum("na,nab,nb->n", error, np.linalg.inv(fixes.covariance), error))
        sites = assign(motion[:2].T, RATE_HZ, panels, level.view)
        deviation = measured_bound(np.full(sites.shape, 10 ** (snr_db / 10)), level.waveform)
        bound = position_bound(motion[:4].T, deviation, panels.take(sites))
        ratios.append(error**2 / np.diagonal(bound, axis1=1, axis2=2))
    low, high = stats.chi2.ppf([0.005, 0.995], 4 * 6000) / 6000
    assert low < np.mean(values) < high
    assert np.all(np.sqrt(np.mean(ratios, axis=(0, 1))) < 1.05)


def test_another_key_is_another_draw_and_the_same_key_the_same() -> None:
    truth = np.stack([drive(40, 100.0, 0.0, 25.0)] * 3)
    one, same, other = sense(truth, SITES, DEFAULT, [("a", 1), ("a", 1), ("a", 2)])
    assert np.array_equal(one.state, same.state)
    assert not np.array_equal(one.state, other.state)


def test_a_vehicle_that_two_sites_do_not_see_is_not_usable() -> None:
    truth = np.stack([drive(40, 100.0, 0.0, 25.0), drive(40, 1e5, 0.0, 25.0)])
    seen, unseen = sense(truth, SITES, DEFAULT, [(0,), (1,)])
    assert seen.usable
    assert not unseen.usable
    assert unseen.n_sites == 0
    assert np.all(unseen.state == 0)
    assert np.all(unseen.fixes == 0)
    assert np.isfinite(unseen.snr_db)


def test_a_vehicle_below_the_noise_is_not_usable_and_one_at_the_threshold_stays_finite() -> None:
    truth = drive(80, 100.0, 0.0, 25.0)[None]
    for level, usable in ((-60, False), (-31, True)):
        faint = DEFAULT.model_copy(update={"channel": ChannelSettings(kind="fixed", snr_db=level)})
        record = sense(truth, SITES, faint, [("faint", level)])[0]
        assert record.usable == usable
        assert record.n_sites == (4 if usable else 0)
        assert np.isfinite(record.state).all()
        if usable:
            assert 0.8 < record.detected < 1
            assert rms((record.state - truth[0])[:2]) < 0.5


def test_a_panel_sees_only_what_is_before_it_and_a_mast_serves_once() -> None:
    panels = Panels.of([Site("n", 0, 0, 20, 0), Site("e", 0, 0, 20, 90), Site("far", 300, 0, 20, 270)], 0.8)
    view = ViewSettings(range_m=250)
    position = np.array([[100.0, 10.0], [10.0, 100.0], [-100.0, 0.0], [50.0, 0.0]])
    sites = [assign(p[None], RATE_HZ, panels, view)[0].tolist() for p in position]
    assert sites == [[1, 2, -1, -1], [0, -1, -1, -1], [-1, -1, -1, -1], [1, -1, -1, -1]]


def plain_choice(place: np.ndarray, panels: Panels, view: ViewSettings) -> list[int]:
    """The nearest panels that see a place, one on each mast; of two as far, the one that faces it more squarely."""
    dx, dy, distance = panels.sight(*place)
    ahead = dx * panels.front[:, 0] + dy * panels.front[:, 1]
    wide = np.hypot(dx, dy) * np.cos(np.radians(view.half_width_deg))
    seen = np.flatnonzero((distance <= view.range_m) & (ahead >= wide))
    nearest: dict[tuple[float, float], int] = {}
    for k in sorted(seen, key=lambda k: (round(distance[k], 3), -ahead[k])):
        nearest.setdefault((panels.x[k], panels.y[k]), int(k))
    chosen = list(nearest.values())[: view.sites]
    return chosen + [-1] * (view.sites - len(chosen))


@pytest.mark.parametrize("sites", [1, 4, 8])
def test_sites_are_the_nearest_of_each_mast(sites: int) -> None:
    rng = np.random.default_rng(sites)
    masts = rng.uniform(0, 600, (9, 2))
    panels = Panels.of([Site(f"s{k}", *masts[k % 9], 10.0 + 5 * (k % 2), rng.uniform(0, 360)) for k in range(24)], 0.8)
    position, view = rng.uniform(-300, 900, (200, 2)), ViewSettings(sites=sites, hold_s=1 / RATE_HZ)
    chosen = assign(position, RATE_HZ, panels, view)
    assert (chosen < 0).any()
    assert chosen.tolist() == [plain_choice(place, panels, view) for place in position]


def test_sites_change_over_as_the_vehicle_drives_on() -> None:
    truth = drive(2000, 0.0, 0.0, 40.0)
    slots = assign(truth[:2].T, RATE_HZ, Panels.of(SITES, 0.8), ViewSettings())
    assert len({tuple(row) for row in slots}) > 1
    changes = np.flatnonzero(np.any(np.diff(slots, axis=0) != 0, axis=1)) + 1
    assert np.all(changes % 40 == 0)


def test_the_run_in_is_the_motion_carried_back() -> None:
    truth = drive(50, 3.0, 4.0, 20.0, along=-2.0, aside=1.0)
    earlier = before(truth[None], RATE_HZ, 3)[0]
    t = -3 / RATE_HZ
    assert earlier[:, 0] == pytest.approx([3 + 20 * t - t**2, 4 + t**2 / 2, 20 - 2 * t, t, -2, 1])


def test_the_run_in_is_the_true_past_as_far_as_it_is_known() -> None:
    """And before that, its first state carried back; more than the run-in takes is not used."""
    whole = drive(60, 3.0, 4.0, 20.0, along=-2.0, aside=1.0)[None]
    whole[:, :, :20] += 5.0  # a past that nobody would guess from the record
    past, truth = whole[:, :, :20], whole[:, :, 20:]
    np.testing.assert_array_equal(run_in(truth, RATE_HZ, 20, past), past)
    np.testing.assert_array_equal(run_in(truth, RATE_HZ, 8, past), past[:, :, 12:])
    longer = run_in(truth, RATE_HZ, 25, past)
    np.testing.assert_array_equal(longer[:, :, 5:], past)
    np.testing.assert_allclose(longer[:, :, :5], before(past, RATE_HZ, 5))
    np.testing.assert_array_equal(run_in(truth, RATE_HZ, 7), before(truth, RATE_HZ, 7))
    assert run_in(truth, RATE_HZ, 0, past).shape == (1, 6, 0)


def test_a_known_past_is_what_the_filter_settles_on() -> None:
    """A vehicle that braked until the record began: carried back at its first state, it would come from elsewhere."""
    t = np.arange(-200, 400) / RATE_HZ
    speed = np.where(t < 0, 20.0 - 6.0 * t, 20.0)
    x = 100.0 + np.where(t < 0, 20.0 * t - 3.0 * t**2, 20.0 * t)
    motion = np.stack([x, 0 * t, speed, 0 * t, np.where(t < 0, -6.0, 0.0), 0 * t])
    truth, past = motion[None, :, 200:], motion[None, :, :200]
    loud = DEFAULT.model_copy(update={"channel": ChannelSettings(kind="fixed", snr_db=20)})
    (guessed,), (known,) = (sense(truth, SITES, loud, [(1,)], past=earlier) for earlier in (None, past))
    assert rms(known.fixes - truth[0, :4]) < 0.5
    # The filter follows what it saw: a deceleration that has only just ended.
    assert known.state[4, 0] < guessed.state[4, 0] - 1.0
    assert known.state[4, -1] == pytest.approx(guessed.state[4, -1], abs=1.0)


def test_the_snr_can_be_set() -> None:
    truth = drive(40, 100.0, 0.0, 25.0)[None]
    low = sense(
        truth, SITES, DEFAULT.model_copy(update={"channel": ChannelSettings(kind="fixed", snr_db=-10)}), [(1,)]
    )[0]
    high = sense(
        truth, SITES, DEFAULT.model_copy(update={"channel": ChannelSettings(kind="fixed", snr_db=20)}), [(1,)]
    )[0]
    assert (low.snr_db, high.snr_db) == (-10, 20)
    ratio = rms(low.fixes - truth[0, :4]) / rms(high.fixes - truth[0, :4])
    assert ratio == pytest.approx(10**1.5, rel=0.3)


@pytest.mark.usefixtures("one_thread")
@pytest.mark.parametrize("estimator", ["ml", "candan", "padded_grid", "grid"])
def test_full_tensors_do_as_the_dft_block_does(estimator: str) -> None:
    truth = drive(12, 130.0, 1.0, 25.0)[None]
    base = {"estimator": estimator, "tracking": {"run_in_s": 0.02}}
    block = SensingSettings.model_validate(base)
    tensor = SensingSettings.model_validate({**base, "echo": "tensor"})
    fast = [sense(truth, SITES, block, [("w", k)])[0] for k in range(20)]
    slow = sense(truth, SITES, tensor, [("t", 0)])[0]
    spread = rms(np.stack([r.fixes for r in fast]) - truth[:, :4])
    assert 0.3 * spread < rms(slow.fixes - truth[0, :4]) < 3 * spread


def test_eq5_and_the_link_budget_run_through_the_chain() -> None:
    truth = drive(80, 130.0, 1.0, 25.0)[None]
    link = {"kind": "link", "rain_mm_per_h": 20}
    best = SensingSettings.model_validate({"channel": link})
    paper = best.model_copy(update={"fusion": FusionSettings(method="eq5")})
    joint, linear = (sense(truth, SITES, s, [("link",)])[0] for s in (best, paper))
    assert joint.snr_db == linear.snr_db
    assert rms(joint.fixes - truth[0, :4]) < 0.5 * rms(linear.fixes - truth[0, :4])


def test_a_truck_in_between_lowers_the_snr() -> None:
    truth = drive(80, 105.0, 0.0, 25.0)
    near = np.arange(20) * 0.25
    ring = [(7.0, 0.0, 1.0, 0.0), (-7.0, 0.0, 1.0, 0.0), (0.0, 4.0, 1.0, 0.0), (0.0, -4.0, 1.0, 0.0)]
    trucks = Blockers(
        [str(k) for k in range(4)],
        0.01,
        np.stack([105 + dx + 6 + near for dx, *_ in ring]),
        np.stack([np.full(20, dy) for _, dy, *_ in ring]),
        np.tile([1.0, 0.0], (4, 20, 1)),
        np.full(4, 12.0),
        np.full(4, 2.5),
        np.full(4, TRUCK_HEIGHT_M),
    )
    blocked = DEFAULT.model_copy(update={"channel": ChannelSettings(kind="fixed", snr_db=0, blockage=True)})
    nobody = Blockers([], 0.01, *(np.zeros((0, 20)),) * 2, np.zeros((0, 20, 2)), *(np.zeros(0),) * 3)
    approach = Approach.of(Passage("tv", 0.0, truth, ("b",)), RATE_HZ, blocked.tracking)
    panels = Panels.of(SITES, blocked.target_height_m)
    hidden, free = (fix(approach, RATE_HZ, panels, blocked, ("b",), others) for others in (trucks, nobody))
    assert free.snr_db == 0
    assert hidden.snr_db < -2
    assert np.isfinite(hidden.fixes.state).all()
    with pytest.raises(InputError, match="blockage needs the other vehicles"):
        sense(truth[None], SITES, blocked, [("b", 0)])


def test_a_view_beyond_the_cyclic_prefix_is_refused() -> None:
    """144 samples at 61.44 MHz are 2.34 us, and light goes out and back over 351 m in them."""
    with pytest.raises(ValidationError, match=r"view.range_m 352 is beyond the 351 m .*: lower it to 351"):
        SensingSettings(view=ViewSettings(range_m=352))
    assert SensingSettings(view=ViewSettings(range_m=351)).view.range_m == 351
    longer = Waveform(cyclic_prefix_s=2 * 352 / 299_792_458 + 1e-12)
    assert SensingSettings(view=ViewSettings(range_m=352), waveform=longer).view.range_m == 352
    assert SensingSettings(view=ViewSettings(range_m=4000), waveform=Waveform(cyclic_prefix_s=None))


def test_names_of_former_versions_are_read() -> None:
    settings = SensingSettings.model_validate({"echo": "window", "tracking": {"prelude_s": 0.25}})
    assert (settings.echo, settings.tracking.run_in_s) == ("block", 0.25)
    assert settings == SensingSettings.model_validate(settings.model_dump(mode="json"))
    with pytest.raises(ValidationError):
        TrackingSettings.model_validate({"prelude_s": 0.25, "run_in_s": 0.5})


def test_a_vehicle_that_drives_off_is_seen_from_where_it_will_go_in_the_run_in() -> None:
    """Carried back at constant acceleration it would have reversed; its cross-section must not turn around for that."""
    truth = drive(400, 60.0, 0.0, 0.0, along=3.0)
    motion = np.concatenate([before(truth[None], RATE_HZ, 200)[0], truth], axis=1)
    assert motion[2, 0] < -1
    assert np.all(_heading_rad(motion, 200) == 0)


def test_a_scenario_without_sites_is_refused() -> None:
    with pytest.raises(InputError, match="isac_site"):
        sense(drive(10, 0.0, 0.0, 20.0)[None], [], DEFAULT, [(0,)])
