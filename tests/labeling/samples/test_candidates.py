"""Which events become samples, with which times, and which are left out."""

from dataclasses import fields, replace

import numpy as np
import pytest
from pydantic import ValidationError
from scipy import stats

from isac_cosim.isacsim.traffic import motion
from isac_cosim.isacsim.traffic.recordings.recording import Recording, Track
from isac_cosim.labeling.detectors.events import Labels, label
from isac_cosim.labeling.detectors.settings import LabelSettings
from isac_cosim.labeling.intentions import Event, Intention
from isac_cosim.labeling.samples.candidates import Candidates, RecordSettings, ambiguous, candidates, record_start
from isac_cosim.labeling.samples.uv_choice import PairSettings
from tests.support.drives import WIDTH_M, Drive, Road, ramps, record, sweep, total

ROAD = Road()
RECORD, PAIRS = RecordSettings(), PairSettings(tv_kinds=("passenger",))
BRAKE = ramps((0, 30), (20, 30), (22, 18), (100, 18))


def offered(recording: Recording, pairs: PairSettings = PAIRS, record_settings: RecordSettings = RECORD) -> Candidates:
    return candidates(recording, label(recording, LabelSettings()), pairs, record_settings)


def lead(**changes: object) -> Drive:
    return Drive(**{"vehicle": "uv", "start_m": 60.0, "kind": "truck", **changes})  # type: ignore[arg-type]


def test_a_brake_becomes_a_sample_with_its_times() -> None:
    recording = record(ROAD, Drive("tv", speed=BRAKE), lead(speed=BRAKE))
    result = offered(recording)
    (sample,) = [sample for sample in result.samples if sample.intention is Intention.HARD_BRAKE]
    (event,) = [e for e in label(recording, LabelSettings()).of(Intention.HARD_BRAKE) if e.vehicle == "tv"]
    assert (sample.tv, sample.uv, sample.provenance.origin, sample.relation) == ("tv", "uv", "natural", "ahead")
    assert (sample.t_onset, sample.t_commit, sample.t_end) == (event.onset, event.commit, event.end)
    assert abs(sample.t_start - (event.onset - 2.6)) <= 0.2
    assert result.left_out["tv_kind"] >= 1


def test_following_ends_with_its_record() -> None:
    result = offered(record(ROAD, Drive("tv"), lead()))
    assert result.samples
    assert all(sample.t_end == pytest.approx(sample.t_start + 5.0) for sample in result.samples)
    assert all(sample.t_commit == sample.t_onset for sample in result.samples)


def test_left_out_and_why() -> None:
    tv = Drive("tv", speed=BRAKE)
    assert offered(record(ROAD, tv)).left_out == {"no_uv": 1}
    assert offered(record(ROAD, tv, lead(duration_s=22.0))).left_out["uv_outside_track"] == 1
    assert offered(record(ROAD, Drive("tv", speed=BRAKE, begin_s=17.5), lead())).left_out["tv_outside_track"] == 1
    both = Drive("tv", speed=BRAKE, lateral=sweep(20.5, 4.0, WIDTH_M))
    assert offered(record(ROAD, both, lead(speed=BRAKE))).left_out["ambiguous"] == 2
    jumpy = Drive("tv", speed=BRAKE, lateral=lambda t: np.where(t > 21, 0.5, 0.0))
    assert offered(record(ROAD, jumpy, lead(speed=BRAKE))).left_out["jump"] == 1


def test_the_record_and_the_kernel_s_reach_lie_within_the_track() -> None:
    exact = RecordSettings(jitter_s=0.0)
    onset = label(record(ROAD, Drive("tv", speed=BRAKE)), LabelSettings()).events[0].onset
    enough = onset + 2.4 + 0.8
    for end, fits in ((enough + 0.02, True), (enough - 0.02, False)):
        recording = record(ROAD, Drive("tv", speed=BRAKE), lead(duration_s=round(end, 2)))
        result = offered(recording, record_settings=exact)
        assert (Intention.HARD_BRAKE in {sample.intention for sample in result.samples}) is fits


def test_the_kernel_s_reach_before_the_record_lies_within_the_track() -> None:
    exact = RecordSettings(jitter_s=0.0)
    onset = label(record(ROAD, Drive("tv", speed=BRAKE)), LabelSettings()).events[0].onset
    for late, fits in ((-0.02, True), (0.02, False)):
        tv = Drive("tv", 500.0, BRAKE, begin_s=round(onset - 2.6 - 0.8 + late, 2))
        result = offered(record(ROAD, tv, lead()), record_settings=exact)
        assert (Intention.HARD_BRAKE in {sample.intention for sample in result.samples}) is fits
        assert result.left_out.get("tv_outside_track", 0) == (not fits)


def pull_out(returns_at: float | None, duration_s: float = 60.0) -> Recording:
    lateral = sweep(10.0, 4.0, WIDTH_M)
    if returns_at is not None:
        lateral = total(lateral, sweep(returns_at, 4.0, -WIDTH_M))
    return record(
        ROAD, Drive("tv", 0.0, 32.0, lateral, duration_s), lead(start_m=120.0, speed=24.0, duration_s=duration_s)
    )


def test_overtake_and_left_lane_change_by_the_outcome_for_the_pair() -> None:
    assert Intention.OVERTAKE in {sample.intention for sample in offered(pull_out(20.0)).samples}
    never = offered(pull_out(None))
    assert never.left_out["passed_did_not_return"] == 1
    assert not {Intention.OVERTAKE, Intention.LEFT_LANE_CHANGE} & {sample.intention for sample in never.samples}
    assert offered(pull_out(None, 30.0)).left_out["unresolved"] == 1


def test_for_a_uv_that_is_not_passed_an_overtake_is_a_left_lane_change() -> None:
    recording = pull_out(20.0)
    far = record(ROAD, Drive("far", 60.0, 33.0, 2 * WIDTH_M, kind="bus"))
    both = Recording("scripted", 7, 0.01, recording.lanes, {**recording.tracks, **far.tracks})
    for kinds, expected in ((None, Intention.OVERTAKE), (("bus",), Intention.LEFT_LANE_CHANGE)):
        pairs = PairSettings(tv_kinds=("passenger",), uv_kinds=kinds, fall_back=True)
        intentions = {sample.intention for sample in offered(both, pairs).samples}
        assert intentions & {Intention.OVERTAKE, Intention.LEFT_LANE_CHANGE} == {expected}


GENTLE_FIRST = ramps((0, 30), (20, 30), (21, 29.0), (23, 26.6), (23.5, 25.0), (25, 17.0), (100, 17.0))
"""Brakes at 1.2 m/s2 for 3 s before it brakes hard."""


@pytest.mark.parametrize(("duration_s", "fits"), [(5.0, False), (6.2, True)])
def test_a_record_that_ends_before_the_commit_is_left_out(duration_s: float, fits: bool) -> None:
    recording = record(ROAD, Drive("tv", speed=GENTLE_FIRST), lead(speed=GENTLE_FIRST))
    brake = next(event for event in label(recording, LabelSettings()).of(Intention.HARD_BRAKE) if event.vehicle == "tv")
    assert 2.6 < brake.commit - brake.onset <= 3.0
    result = offered(recording, record_settings=RecordSettings(duration_s=duration_s))
    brakes = [sample for sample in result.samples if sample.intention is Intention.HARD_BRAKE]
    assert len(brakes) == fits
    assert result.left_out.get("commit_outside_record", 0) == (not fits)
    assert all(sample.t_start <= sample.t_commit <= sample.t_start + duration_s for sample in result.samples)


@pytest.mark.parametrize(("duration_s", "kept"), [(4.0, True), (8.0, False)])
def test_a_slow_lane_change_whose_crossing_is_not_in_the_record_is_left_out(duration_s: float, kept: bool) -> None:
    recording = record(ROAD, Drive("tv", lateral=sweep(20.0, duration_s, WIDTH_M)), lead())
    result = offered(recording)
    changes = [sample for sample in result.samples if sample.intention is Intention.LEFT_LANE_CHANGE]
    assert len(changes) == kept
    assert result.left_out.get("commit_outside_record", 0) == (not kept)


@pytest.mark.parametrize(
    ("onset", "end", "expected"),
    [(8.0, 9.4, False), (8.0, 9.6, True), (12.3, 13.0, True), (12.5, 13.0, False), (5.0, 20.0, True)],
)
def test_ambiguity_is_another_event_under_way_from_half_a_second_before_to_the_end(
    onset: float, end: float, expected: bool
) -> None:
    event = Event("tv", Intention.HARD_BRAKE, 10.0, 10.3, 12.0, -6.0)
    other = Event("tv", Intention.RIGHT_LANE_CHANGE, onset, onset, end, 1.0)
    assert ambiguous(event, [event, other], RECORD) is expected


def test_a_longer_record_excludes_other_events_until_its_end() -> None:
    event = Event("tv", Intention.HARD_BRAKE, 10.0, 10.3, 12.0, -6.0)
    other = Event("tv", Intention.RIGHT_LANE_CHANGE, 15.0, 15.0, 16.0, 1.0)
    assert not ambiguous(event, [event, other], RECORD)
    assert ambiguous(event, [event, other], RecordSettings(duration_s=10.0))


@pytest.mark.parametrize("duration_s", [5.0, 10.0])
def test_following_has_one_leader_in_all_of_its_record(duration_s: float) -> None:
    """After half a minute another vehicle moves in between, so that the leader changes."""
    between = Drive("other", start_m=30.0, kind="truck", lateral=lambda t: WIDTH_M + sweep(32.0, 4.0, -WIDTH_M)(t))
    recording = record(ROAD, Drive("tv"), lead(), between)
    samples = offered(recording, record_settings=RecordSettings(duration_s=duration_s)).samples
    starts = [sample.t_start for sample in samples if sample.intention is Intention.FOLLOWING]
    assert any(start < 25.0 for start in starts)
    assert any(start > 35.0 for start in starts)
    assert not any(start < 33.5 and start + duration_s > 34.5 for start in starts)


def test_an_overtake_is_under_way_only_while_it_pulls_out() -> None:
    event = Event("tv", Intention.HARD_BRAKE, 10.0, 10.3, 12.0, -6.0)
    overtake = Event("tv", Intention.OVERTAKE, 2.0, 4.0, 20.0, 1.0, motion_end=6.0)
    assert not ambiguous(event, [event, overtake], RECORD)


def test_the_place_of_the_onset_in_the_record_is_independent_of_the_class() -> None:
    recording = record(ROAD, Drive("tv", duration_s=1.0))
    rng = np.random.default_rng(3)
    placed = {}
    for intention in Intention:
        onsets = rng.uniform(10, 3000, 400)
        events = [Event("tv", intention, float(t), float(t) + 0.5, float(t) + 3, 1.0) for t in onsets]
        placed[intention] = np.array([e.onset - record_start(recording, e, RECORD) for e in events])
    assert stats.kruskal(*placed.values()).pvalue > 0.01
    for at in placed.values():
        assert stats.kstest(at, stats.uniform(2.4, 0.4).cdf).pvalue > 0.001
    same = [record_start(recording, Event("tv", i, 77.0, 78.0, 79.0, 1.0), RECORD) for i in Intention]
    assert len(set(same)) == 1


def test_no_signal_of_a_vehicle_is_recorded_or_becomes_a_feature() -> None:
    """Only the motion of a vehicle is recorded, and which road lies ahead; features come from its positions alone."""
    facts = {"vehicle", "kind", "length_m", "width_m", "first_step", "onward", "departed", "bystander"}
    states = {"x", "y", "speed", "lane", "lane_pos", "lane_lat"}
    assert {column.name for column in fields(Track)} == facts | states
    recording = record(ROAD, Drive("tv", speed=BRAKE, lateral=sweep(20.5, 4.0, WIDTH_M)))
    track, times = recording.tracks["tv"], np.arange(10.0, 15.0, 0.0025)
    zeros = {name: np.zeros_like(getattr(track, name)) for name in states - {"x", "y"}}
    bare = replace(track, kind="", length_m=0.0, width_m=0.0, **zeros)
    features = motion.states(recording, track, times, motion.MotionSettings())
    assert np.array_equal(features, motion.states(recording, bare, times, motion.MotionSettings()))


def test_an_onset_that_can_leave_the_record_is_refused() -> None:
    with pytest.raises(ValidationError, match="jitter_s"):
        RecordSettings(before_onset_s=4.9, jitter_s=0.2)


def test_labels_carry_their_settings() -> None:
    labels = label(record(ROAD, Drive("tv", speed=BRAKE)), LabelSettings())
    assert isinstance(labels, Labels)
    assert labels.settings.preset == "isac-2"


def test_a_record_beyond_a_car_in_the_plane_is_left_out_for_the_tv_and_for_the_uv() -> None:
    recording = record(ROAD, Drive("tv", speed=BRAKE), lead(speed=BRAKE))
    for vehicle in ("tv", "uv"):
        track = recording.tracks[vehicle]
        shaken = np.where((np.arange(len(track)) // 100) % 2 == 0, 0.0, 0.25)  # steps of the lane's centre line, 1 Hz
        tracks = {**recording.tracks, vehicle: replace(track, y=track.y + shaken)}
        labels, plane = (
            label(replace(recording, tracks=tracks), LabelSettings()),
            motion.MotionSettings(max_shift_m=0.0),
        )
        offered_all = candidates(replace(recording, tracks=tracks), labels, PAIRS, RECORD)
        kept = candidates(replace(recording, tracks=tracks), labels, PAIRS, RECORD, motion=plane)
        assert len(offered_all.samples) > len(kept.samples) == 0
        assert kept.left_out["beyond_car"] == len(offered_all.samples)


@pytest.mark.parametrize("vehicle", ["tv", "uv"])
def test_a_record_too_sharp_for_drivers_is_left_out_but_a_swerve_is_not(vehicle: str) -> None:
    """A bend that takes 5 m/s2 across, within the record, or far from it."""
    recording = record(ROAD, Drive("tv", speed=BRAKE), lead(speed=BRAKE))
    track = recording.tracks[vehicle]
    plane = motion.MotionSettings(max_shift_m=0.0)
    for at_s, left_out in ((21.0, True), (50.0, False)):
        t = recording.times(track)
        aside = 5.0 / (2 * np.pi / 1.6) ** 2 * np.sin(2 * np.pi / 1.6 * (t - at_s)) * np.exp(-((t - at_s) ** 2))
        bent = replace(recording, tracks={**recording.tracks, vehicle: replace(track, y=track.y + aside)})
        labels = label(bent, LabelSettings())
        kept = candidates(bent, labels, PAIRS, RECORD, motion=plane)
        assert (kept.left_out.get("beyond_driver", 0) > 0) == left_out
        unlimited = RECORD.model_copy(update={"across_mps2": None})
        assert "beyond_driver" not in candidates(bent, labels, PAIRS, unlimited, motion=plane).left_out


def test_across_acceleration_of_a_swerve_is_its_own() -> None:
    out_and_back = total(sweep(20.0, 1.3, 1.5), sweep(21.4, 1.3, -1.5))
    recording = record(ROAD, Drive("tv", lateral=out_and_back), lead())
    labels = label(recording, LabelSettings())
    assert [event.vehicle for event in labels.of(Intention.EVASIVE_SWERVE)] == ["tv"]
    state = motion.states(recording, recording.tracks["tv"], np.arange(19.0, 24.0, 0.01), motion.MotionSettings())
    assert np.abs(state[5]).max() > 4.0
    kept = candidates(recording, labels, PAIRS, RECORD, motion=motion.MotionSettings())
    assert Intention.EVASIVE_SWERVE in {sample.intention for sample in kept.samples}
