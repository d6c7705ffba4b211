"""Stretches are sensed where enough sites see them, and nothing but the conditioning kernel looks ahead."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from isac_cosim.evaluation.in_traffic.settings import LiveStudy
from isac_cosim.evaluation.in_traffic.streams.predictions import WindowCutter
from isac_cosim.isacsim.scenarios.scenario import Scenario, Site
from isac_cosim.isacsim.sensing.sensors import DEFAULT
from isac_cosim.isacsim.traffic.recordings.recording import COLUMNS, Recording
from isac_cosim.labeling.generation.settings import DatasetStudy
from isac_cosim.labeling.generation.watching import watch_episode
from isac_cosim.labeling.road.surroundings import Surroundings
from isac_cosim.labeling.streams.reports import Reports
from isac_cosim.labeling.streams.sensed import StretchSensing, spans
from isac_cosim.labeling.streams.stretches import Stretch, Timing, watched
from isac_cosim.models.data.windows import WindowSettings, in_frame
from isac_cosim.models.predictors.protocol import WindowShape

TIMING = Timing(
    decision_s=0.1, window_s=1.2, report_delay_s=0.0, run_in_s=0.5, margin_s=0.8, outcome_s=0.0, longest_stretch_s=120.0
)
KERNEL_S = 1.2
"""Reach of the conditioning kernel: 8 standard deviations of 0.15 s."""


def noiseless(study: LiveStudy) -> LiveStudy:
    content = study.model_dump()
    content["dataset"]["sensing"]["channel"] |= {"kind": "fixed", "snr_db": 80.0}
    content["dataset"]["report"] |= {"position_sd_m": 0.0, "speed_sd_mps": 0.0, "acceleration_sd_mps2": 0.0}
    return LiveStudy.model_validate(content)


def cut(recording: Recording, end_s: float) -> Recording:
    """The recording as it is known at a time: nothing later."""
    tracks = {}
    for name, track in recording.tracks.items():
        rows = round(end_s / recording.step_s) + 1 - track.first_step
        tracks[name] = replace(track, **{column: getattr(track, column)[:rows] for column in COLUMNS})
    return replace(recording, tracks=tracks)


def sensing_of(study: DatasetStudy, scenario: Scenario, recording: Recording, name: str = DEFAULT) -> StretchSensing:
    sensor = watch_episode(study, scenario, recording.seed, recording, name)
    return StretchSensing(study, recording, sensor, TIMING.before_decision_s)


def states_of(recording: Recording, scenario: Scenario, study: LiveStudy, tv: str) -> dict[int, np.ndarray]:
    """What the network knows of a TV, (6,), and of its UV, (6,), by the number of the decision."""
    sensing = sensing_of(study.dataset, scenario, recording)
    driving = watched(recording, Surroundings(recording), study.dataset.pairs, TIMING)
    reports, known = Reports(sensing), {}
    for track in sensing.tracks([stretch for stretch in driving.stretches if stretch.tv == tv]):
        for time, uv in zip(track.stretch.decision_s.tolist(), track.stretch.uv, strict=True):
            sample = round((time - track.stretch.start_s) * 400)
            known[round(time * 10)] = np.concatenate([track.state[:, sample], reports.window(uv, time, 1)[:, 0]])
    return known


def test_only_the_kernel_looks_ahead(recording: Recording, scenario: Scenario, study: LiveStudy) -> None:
    """The raw recording is cut just before a hard brake. What was known 1.2 s before the cut stays as it is.

    The echoes' noise is drawn anew for the shorter stretch; at 80 dB it is some tens of micrometres, and 0.05 m/s2.
    """
    quiet, speed = noiseless(study), recording.tracks["follow0"].speed
    cut_s = round(float(np.flatnonzero(np.diff(speed) < -0.01)[0]) * recording.step_s, 1)
    whole = states_of(recording, scenario, quiet, "follow0")
    known = states_of(cut(recording, cut_s), scenario, quiet, "follow0")
    assert max(known) == pytest.approx((cut_s - 0.8) * 10, abs=1)
    change = {number: np.abs(known[number] - whole[number]) for number in known}
    early = np.max([row for number, row in change.items() if number / 10 <= cut_s - KERNEL_S], axis=0)
    np.testing.assert_array_less(early[[0, 1]], 0.002)
    np.testing.assert_array_less(early[[4, 5]], 0.05)
    np.testing.assert_array_equal(early[6:], 0)


def test_what_changes_within_the_reach_of_the_kernel_is_small(
    recording: Recording, scenario: Scenario, study: LiveStudy
) -> None:
    """The motion that all of it comes from, up to the cut itself: centimetres at 0.6 s, more at the very end."""
    cut_s = float(recording.times(recording.tracks["follow0"])[1400])
    sensing = sensing_of(study.dataset, scenario, recording)
    blind = sensing_of(study.dataset, scenario, cut(recording, cut_s))
    times = cut_s - 2.0 + np.arange(200) / 100
    change = np.abs(
        blind.motion_of("follow0", cut_s - 2.0, 200, 100.0) - sensing.motion_of("follow0", cut_s - 2.0, 200, 100.0)
    )
    np.testing.assert_allclose(change[:, times < cut_s - KERNEL_S - 0.02], 0, atol=1e-9)
    far = times < cut_s - 0.6
    assert change[:2, far].max() < 0.001
    assert change[:2].max() < 0.2


def test_a_gap_in_view_divides_a_stretch(recording: Recording, scenario: Scenario, study: LiveStudy) -> None:
    """Sites at both ends of the way: in between fewer than two see the vehicle."""
    near = [site for site in scenario.sites if site.x < 400.0]
    far = [replace(site, x=site.x + 450.0) for site in near]
    sites: list[Site] = [*near, *far]
    view = study.dataset.sensing.view.model_copy(update={"range_m": 200.0})
    sensing_settings = study.dataset.sensing.model_copy(update={"view": view})
    narrow = study.dataset.model_copy(update={"sensing": sensing_settings})
    sensing = sensing_of(narrow, replace(scenario, sites=tuple(sites)), recording)
    driving = watched(recording, Surroundings(recording), narrow.pairs, TIMING)
    stretch = next(stretch for stretch in driving.stretches if stretch.tv == "follow0")
    tracks = list(sensing.tracks([stretch]))
    predicted = sum(len(track.stretch.decision_s) for track in tracks)
    assert len(tracks) == 2
    assert predicted + sensing.uncovered["too_few_sites"] == len(stretch.decision_s)
    first, second = (track.stretch for track in tracks)
    assert second.start_s - first.end_s > 1.0
    assert second.decision_s[0] == pytest.approx(second.start_s + TIMING.before_decision_s, abs=0.11)
    for track in tracks:
        error = np.hypot(*(track.state[:2, 300:] - track.truth[:2, 300:]))
        assert np.median(error) < 0.5
        assert track.state.shape == track.truth.shape


def spanned(stretch: Stretch) -> tuple[str, float, float, int]:
    return stretch.tv, stretch.start_s, stretch.end_s, len(stretch.decision_s)


def test_the_truth_is_the_motion_itself(recording: Recording, scenario: Scenario, study: LiveStudy) -> None:
    sensing = sensing_of(study.dataset, scenario, recording, "truth")
    driving = watched(recording, Surroundings(recording), study.dataset.pairs, TIMING)
    tracks = list(sensing.tracks(driving.stretches))
    assert [spanned(track.stretch) for track in tracks] == [spanned(stretch) for stretch in driving.stretches]
    for track in tracks:
        np.testing.assert_array_equal(track.state, track.truth)


def test_the_radar_of_the_uv_ahead_senses_a_stretch(recording: Recording, scenario: Scenario, study: LiveStudy) -> None:
    sensing = sensing_of(study.dataset, scenario, recording, "radar")
    driving = watched(recording, Surroundings(recording), study.dataset.pairs, TIMING)
    tracks = list(sensing.tracks(driving.stretches))
    assert [spanned(track.stretch) for track in tracks] == [spanned(stretch) for stretch in driving.stretches]
    for track in tracks:
        error = (track.state - track.truth)[:2, 800:]
        assert 0.01 < np.sqrt(np.mean(error**2)) < 0.5
    assert driving.alone
    assert list(sensing.tracks(driving.alone)) == []
    assert sensing.uncovered["not_detected"] == sum(len(stretch.decision_s) for stretch in driving.alone)


def test_when_the_uv_changes_the_track_goes_on_with_the_new_ones_radar(
    recording: Recording, scenario: Scenario, study: LiveStudy
) -> None:
    """The other leader drives 200 m further ahead. Halfway, it takes over."""
    driving = watched(recording, Surroundings(recording), study.dataset.pairs, TIMING)
    stretch = next(stretch for stretch in driving.stretches if stretch.tv == "follow0")
    half = len(stretch.uv) // 2
    shared = replace(stretch, uv=(*stretch.uv[:half], *["lead1"] * (len(stretch.uv) - half)))
    sensing = sensing_of(study.dataset, scenario, recording, "radar")
    (before,), (after,) = (list(sensing.tracks([of])) for of in (stretch, shared))
    until = round((stretch.decision_s[half - 1] - stretch.start_s) * 400)
    np.testing.assert_array_equal(before.state[:, :until], after.state[:, :until])
    assert not np.array_equal(before.state[:, until:], after.state[:, until:])
    assert np.sqrt(np.mean((after.state - after.truth)[:2, until : until + 800] ** 2)) < 1.0


def test_windows_are_as_precise_20_km_from_the_origin(
    recording: Recording, scenario: Scenario, study: LiveStudy
) -> None:
    """The same traffic, moved. float32 has steps of 2 mm there."""
    far_m = 20_000.0
    tracks = {name: replace(track, x=track.x + far_m, y=track.y + far_m) for name, track in recording.tracks.items()}
    lanes = tuple(replace(lane, shape=lane.shape + far_m) for lane in scenario.lanes)
    sites = tuple(replace(site, x=site.x + far_m, y=site.y + far_m) for site in scenario.sites)
    far = replace(scenario, lanes=lanes, sites=sites), replace(recording, tracks=tracks, lanes=lanes)
    windows = []
    for where, traffic in ((scenario, recording), far):
        sensing = sensing_of(study.dataset, where, traffic)
        driving = watched(traffic, Surroundings(traffic), study.dataset.pairs, TIMING)
        cutter = WindowCutter(Reports(sensing), study.dataset, WindowShape(6, 480, 120, 400.0, 100.0), 0.0, 0.1)
        for track in sensing.tracks([stretch for stretch in driving.stretches if stretch.tv == "follow0"]):
            settings = WindowSettings(window_s=1.2)
            windows += [in_frame(*streams, settings, 400.0, 100.0) for streams in cutter.batches(track)]
            windows += [in_frame(*streams, settings, 400.0, 100.0) for streams in cutter.batches(track.true)]
    half = len(windows) // 2
    assert half >= 2
    for near, moved in zip(windows[:half], windows[half:], strict=True):
        assert len(near) > 10
        np.testing.assert_allclose(moved.tv, near.tv, rtol=0, atol=1e-4)
        np.testing.assert_allclose(moved.uv, near.uv, rtol=0, atol=1e-4)


def test_spans_are_the_runs_of_a_mask() -> None:
    assert spans(np.array([True, True, False, True, False])) == [(0, 2), (3, 4)]
    assert spans(np.zeros(3, dtype=bool)) == []
