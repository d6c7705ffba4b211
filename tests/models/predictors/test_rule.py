"""The rule of the road: what it sees of a drive along a bend, what it concludes, and its run."""

import dataclasses
import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from isac_cosim.base.errors import InputError
from isac_cosim.evaluation.on_windows.evaluation import evaluate_records
from isac_cosim.evaluation.on_windows.settings import EvaluateSettings
from isac_cosim.labeling.intentions import Intention
from isac_cosim.models.data.lane_map import LaneMap
from isac_cosim.models.data.windows import OnMap, Records, Windows, WindowSettings, cut, draw_ends
from isac_cosim.models.inference import Infer
from isac_cosim.models.predictors.rule import FITTED, Drive, RuleSettings, drive, fitted, logits, strengths
from isac_cosim.models.runs.run import Run, load_run
from isac_cosim.models.training.training import train_records
from tests.support.made_up import MADE_OF, SMALL_RUN, TV_RATE_HZ, UV_RATE_HZ, make_records

RADIUS_M, WIDTH_M, WINDOW_S = 300.0, 3.6, 2.2
RULE = RuleSettings()


@dataclasses.dataclass(frozen=True)
class Line:
    shape: np.ndarray
    width_m: float = WIDTH_M
    id: str = "road_0"


def on_bend(along: np.ndarray, offset: np.ndarray, rate_hz: float) -> np.ndarray:
    """States (6, n) of a vehicle that has driven `along` metres of a left bend, `offset` left of its lane's centre."""
    angle = along / RADIUS_M
    out = np.stack([np.sin(angle), -np.cos(angle)])
    position = np.array([[0.0], [RADIUS_M]]) + (RADIUS_M - offset) * out
    velocity = np.gradient(position, 1 / rate_hz, axis=1, edge_order=2)
    return np.concatenate([position, velocity, np.gradient(velocity, 1 / rate_hz, axis=1, edge_order=2)])


def window_on_bend(
    speed: float = 25.0, acceleration: float = 0.0, aside: float = 0.0, start: float = 0.0, gap: float = -50.0,
    uv_speed: float = 25.0, uv_offset: float = 0.0, noise: float = 0.0,
) -> Windows:  # fmt: skip
    """One window on two lanes of a bend. gap: the UV is so far ahead at its end."""
    t, t_uv = (np.arange(round(WINDOW_S * rate)) / rate for rate in (TV_RATE_HZ, UV_RATE_HZ))
    at = 60 + speed * t + acceleration / 2 * t**2
    tv = on_bend(at, start + aside * t, TV_RATE_HZ)
    tv[2:4] += noise * np.random.default_rng(0).normal(size=tv[2:4].shape)
    uv = on_bend(at[-1] + gap + uv_speed * (t_uv - t_uv[-1]), np.full(len(t_uv), uv_offset), UV_RATE_HZ)
    angle = np.linspace(0, np.pi / 2, 181)
    lines = [(RADIUS_M - side) * np.stack([np.sin(angle), -np.cos(angle)], axis=1) for side in (0, WIDTH_M)]
    shapes = [line + np.array([0, RADIUS_M]) for line in lines]
    lanes = LaneMap.of([Line(shape, id=f"road_{k}") for k, shape in enumerate(shapes)])
    on_map = OnMap.in_one(tv[None], uv[None], TV_RATE_HZ, lanes)
    return Windows(tv[None].astype(np.float32), uv[None].astype(np.float32), on_map)


def test_a_drift_in_a_bend_is_seen_as_lateral_speed_and_no_acceleration() -> None:
    drives = drive(window_on_bend(aside=0.5, start=-0.3), RULE.smooth_s)
    t_end = WINDOW_S - 1 / TV_RATE_HZ
    assert drives.aside[0] == pytest.approx(0.5, abs=0.01)
    assert drives.left[0] == pytest.approx(WIDTH_M / 2 + 0.3 - 0.5 * t_end, abs=0.03)
    assert drives.right[0] == pytest.approx(WIDTH_M / 2 - 0.3 + 0.5 * t_end, abs=0.03)
    assert drives.swerve[0] < 0.15
    assert abs(drives.brake[0]) < 0.1
    assert abs(drives.accel[0]) < 0.1


@pytest.mark.parametrize("acceleration", [-5.0, 3.0])
def test_braking_and_accelerating_are_seen_along_the_lane(acceleration: float) -> None:
    drives = drive(window_on_bend(acceleration=acceleration), RULE.smooth_s)
    assert drives.accel[0] == pytest.approx(acceleration, abs=0.05)
    assert drives.brake[0] == pytest.approx(-acceleration, abs=0.05)


@pytest.mark.parametrize("smooth_s", [1e-3, 1e3])
def test_fits_have_three_samples_at_least_and_no_more_than_there_are(smooth_s: float) -> None:
    assert np.isfinite(strengths(drive(window_on_bend(), smooth_s), RULE)).all()


def test_a_crossed_marking_is_that_of_the_lane_the_window_began_in() -> None:
    drives = drive(window_on_bend(aside=1.2), RULE.smooth_s)
    assert drives.left[0] == pytest.approx(WIDTH_M / 2 - 1.2 * WINDOW_S, abs=0.05)
    assert strengths(drives, RULE)[0, Intention.LEFT_LANE_CHANGE] == 1


def test_the_strength_of_a_change_is_the_threshold_over_the_time_to_line_crossing() -> None:
    for sign, intention in ((1, Intention.LEFT_LANE_CHANGE), (-1, Intention.RIGHT_LANE_CHANGE)):
        strength = strengths(drive(window_on_bend(aside=sign * 0.4), RULE.smooth_s), RULE)[0]
        time = (WIDTH_M / 2 - 0.4 * WINDOW_S) / 0.4
        assert strength[intention] == pytest.approx(RULE.line_crossing_s / time, rel=0.05)
        assert strength.argmax() == intention


@pytest.mark.parametrize(
    ("motion", "level"),
    [
        ({"gap": 40.0, "uv_speed": 20.0}, 8.0),
        ({"gap": 40.0, "uv_speed": 26.0}, np.inf),
        ({"gap": -40.0, "uv_speed": 20.0}, np.inf),
        ({"gap": 40.0, "uv_speed": 20.0, "uv_offset": WIDTH_M}, np.inf),
    ],
)
def test_the_tv_is_level_with_a_slower_uv_ahead_in_its_lane(motion: dict[str, float], level: float) -> None:
    assert drive(window_on_bend(**motion), RULE.smooth_s).level[0] == pytest.approx(level, rel=0.03)


def test_a_left_change_behind_a_slower_uv_is_an_overtake() -> None:
    for uv_speed, intention in ((20.0, Intention.OVERTAKE), (26.0, Intention.LEFT_LANE_CHANGE)):
        window = window_on_bend(aside=0.7, gap=40.0, uv_speed=uv_speed)
        assert logits(drive(window, RULE.smooth_s), RULE)[0].argmax() == intention


@pytest.mark.parametrize(("uv_speed", "intention"), [(20.0, Intention.OVERTAKE), (26.0, Intention.RIGHT_LANE_CHANGE)])
def test_where_traffic_keeps_left_a_right_change_overtakes(uv_speed: float, intention: Intention) -> None:
    """The mirror image of a drive has the mirror image of its answer, and the same strengths."""
    window = window_on_bend(aside=0.7, gap=40.0, uv_speed=uv_speed)
    here, there = (strengths(drive(w, RULE.smooth_s), RULE)[0] for w in (window, mirrored(window)))
    assert there.argmax() == intention
    swapped = list(range(6))
    swapped[Intention.LEFT_LANE_CHANGE], swapped[Intention.RIGHT_LANE_CHANGE] = 2, 1
    np.testing.assert_allclose(there, here[swapped], rtol=1e-6)


def mirrored(windows: Windows) -> Windows:
    """Return windows and roads mirrored at the x axis: what kept right keeps left."""
    assert windows.on_map is not None
    flip = np.array([1.0, -1.0] * 3)[:, None]
    angle = np.linspace(0, np.pi / 2, 181)
    shapes = [
        (RADIUS_M - side) * np.stack([np.sin(angle), np.cos(angle)], axis=1) - np.array([0, RADIUS_M])
        for side in (0, WIDTH_M)
    ]
    lanes = LaneMap.of([Line(shape, id=f"road_{k}") for k, shape in enumerate(shapes)])
    assert lanes.lefthand
    on_map = dataclasses.replace(
        windows.on_map, tv=windows.on_map.tv * flip, uv=windows.on_map.uv * flip, lane_maps=lambda _: lanes
    )
    tv, uv = (states * flip.astype(np.float32) for states in (windows.tv, windows.uv))
    return Windows(tv, uv, on_map)


def test_noise_of_single_samples_is_no_maneuver() -> None:
    window = window_on_bend(noise=0.1)
    assert np.abs(np.diff(window.on_map.tv[0, 2])).max() * TV_RATE_HZ > 50  # type: ignore[union-attr]
    assert strengths(drive(window, RULE.smooth_s), RULE).max() < 0.7


def test_fitting_scales_thresholds_that_are_far_off() -> None:
    rng = np.random.default_rng(0)
    label = np.repeat(np.arange(6), 30)
    quiet = {name: rng.uniform(0, 0.5, 180) for name in ("accel", "brake", "swerve")}
    strong = {"brake": Intention.HARD_BRAKE, "accel": Intention.HARD_ACCEL, "swerve": Intention.EVASIVE_SWERVE}
    for name, intention in strong.items():
        quiet[name][label == intention] = rng.uniform(3, 6, 30)
    aside = np.select([np.isin(label, (1, 3)), label == 2], [0.6, -0.6], 0.0)
    level = np.where(label == 3, rng.uniform(2, 20, 180), rng.uniform(60, 90, 180))
    drives = Drive(
        left=np.full(180, 1.2), right=np.full(180, 1.2), aside=aside, level=level, lefthand=np.zeros(180, bool), **quiet
    )
    poor = RuleSettings(brake_mps2=20, swerve_mps2=0.4, level_s=5.0)
    scaled = fitted(drives, label, poor)
    before, after = ((logits(drives, s).argmax(axis=1) == label).mean() for s in (poor, scaled))
    assert before < 0.7
    assert after > 0.97
    assert {name for name in RuleSettings.model_fields if getattr(scaled, name) != getattr(poor, name)} <= set(FITTED)


def test_windows_without_roads_are_refused() -> None:
    with pytest.raises(InputError, match="without roads"):
        drive(dataclasses.replace(window_on_bend(), on_map=None), RULE.smooth_s)


@pytest.fixture(scope="module")
def on_roads() -> Records:
    """Made-up records, each alone on a straight lane along its first motion."""
    records = make_records(seeds=6, per_class=2)
    names = records.table["sample_id"].tolist()
    lanes = {}
    for name, states in zip(names, records.tv.astype(float), strict=True):
        direction = states[2:4, :40].mean(axis=1)
        direction /= np.hypot(*direction)
        lanes[name] = LaneMap.of([Line(states[:2, 0] + np.outer([-50, 250], direction))])
    table = records.table.assign(scenario=names)
    return dataclasses.replace(records, table=table, lane_maps=lanes.__getitem__)


@pytest.fixture(scope="module", params=[False, True], ids=["plain", "fitted"])
def rule_run(on_roads: Records, tmp_path_factory: pytest.TempPathFactory, request: pytest.FixtureRequest) -> Run:
    settings = SMALL_RUN.model_copy(update={"model": "rule", "rule": RuleSettings(fit=request.param)})
    return train_records(on_roads, MADE_OF, tmp_path_factory.mktemp("runs") / "rule", settings)


def test_a_run_of_the_rule_is_trained_loaded_and_evaluated(on_roads: Records, rule_run: Run, tmp_path: Path) -> None:
    ends = draw_ends(on_roads, WindowSettings(window_s=1.2, end_after_s=(1.0, 2.0)), "test")
    windows = cut(on_roads, ends, rule_run.card.settings.windows)
    again = load_run(rule_run.path)
    np.testing.assert_array_equal(again.predictor(windows).logits, rule_run.predictor(windows).logits)
    stored = RuleSettings.model_validate(json.loads((rule_run.path / "rule.json").read_text()))
    if not rule_run.card.settings.of(RuleSettings).fit:
        assert stored == RULE
    result = evaluate_records(rule_run, on_roads, MADE_OF, tmp_path / "report", EvaluateSettings()).result
    assert result.name == "rule of the road"
    assert result.macro_f1 is not None
    assert result.macro_f1 > 0.6


def test_damaged_thresholds_are_reported(rule_run: Run, tmp_path: Path) -> None:
    run = tmp_path / "run"
    shutil.copytree(rule_run.path, run)
    (run / "rule.json").write_text('{"smooth_s": -1}')
    with pytest.raises(InputError, match="damaged"):
        load_run(run)


def test_inference_takes_the_lanes_beside_the_window(rule_run: Run) -> None:
    infer = Infer.load(rule_run.path)
    whole = window_on_bend(acceleration=-5.0)
    tv, uv = whole.on_map.tv[0, :, -480:], whole.on_map.uv[0, :, -120:]  # type: ignore[union-attr]
    inference = infer(tv, uv, whole.on_map.lane_maps("bend"))  # type: ignore[union-attr]
    assert inference.intentions == ["hard_brake"]
    with pytest.raises(InputError, match="without roads"):
        infer(tv, uv)
