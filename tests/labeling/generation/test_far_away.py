"""A network that extends over 20 km: what is stored and predicted there is as precise as near the origin."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from isac_cosim.base.settings import checked
from isac_cosim.isacsim.scenarios import scenario as scenarios
from isac_cosim.labeling.dataset.dataset import Dataset
from isac_cosim.labeling.dataset.record_point import GRID_M, in_plane
from isac_cosim.labeling.generation.generate import generate
from isac_cosim.labeling.generation.resense import ResenseSettings, own_sensing, resense
from isac_cosim.labeling.generation.settings import DatasetStudy
from isac_cosim.models.data.windows import OnMap, Records, WindowSettings, cut, draw_ends
from tests.support.roads import straight_road, vehicle
from tests.support.scripted import InlineEngine

FAR_M = 20_000.0
STUDY = {
    "seeds": {"first": 1, "last": 2},
    "traffic": {"run_in_s": 30.0, "duration_s": 40.0},
    "maneuvers": {"rest_s": 1.0},
}


def made(folder: Path, shift: float) -> Dataset:
    """Generate a dataset on a straight road that starts this far from the origin, m, in x and in y."""
    sites = "".join(
        f'<poi id="s{k}" x="{shift + 60 + 150 * (k // 2)}" y="{shift + (80 if k % 2 else -80)}" type="isac_site">'
        f'<param key="height" value="15"/><param key="azimuth" value="{180 if k % 2 else 0}"/></poi>'
        for k in range(24)
    )
    cars = "".join(vehicle(f"v{k}", 2.5 * k, lane=1, speed=20.0) for k in range(12))
    road = straight_road(folder / "road", cars, sites, shift=shift)
    study = checked(DatasetStudy, {"scenarios": [str(road)], **STUDY}, "test")
    return generate(study, folder / "data", InlineEngine())


@pytest.fixture(scope="module")
def pair(tmp_path_factory: pytest.TempPathFactory) -> tuple[Dataset, Dataset]:
    """The same traffic near the origin, and far away in a plane that has its origin where SUMO has it."""
    with pytest.MonkeyPatch.context() as patch:
        # As if another part of the network lay on the other side of the origin.
        patch.setattr(scenarios, "PLANE_REACH_M", 1e6)
        near, far = (made(tmp_path_factory.mktemp("extent"), shift) for shift in (0.0, FAR_M))
    assert far.meta.scenarios[0].origin == (0.0, 0.0)
    return near, far


def test_records_are_the_same_but_for_their_point(pair: tuple[Dataset, Dataset]) -> None:
    near, far = pair
    far.verify()
    first, second = near.frame(), far.frame()
    assert len(first) > 10
    assert first.drop(columns=["x0", "y0", "snr_db"]).equals(second.drop(columns=["x0", "y0", "snr_db"]))
    for axis in ("x0", "y0"):
        assert (second[axis] - first[axis] == FAR_M).all()
        assert (second[axis] % GRID_M == 0.0).all()
    for name, values in near.arrays("tv", "tv_truth", "uv", "tv_run_in").items():
        assert np.abs(values[:, :2]).max() < 400.0
        np.testing.assert_allclose(far.arrays(name)[name], values, rtol=0, atol=1e-4)


def test_velocities_are_the_slopes_of_stored_positions(pair: tuple[Dataset, Dataset]) -> None:
    """Positions as float32 in the plane would jump by 2 mm, which is 0.3 m/s and more between two states."""
    _, far = pair
    truth = far.arrays("tv_truth")["tv_truth"].astype(float)
    slopes = np.diff(truth[:, :2], axis=2) * far.meta.tv_rate_hz
    np.testing.assert_allclose(slopes, (truth[:, 2:4, 1:] + truth[:, 2:4, :-1]) / 2, atol=0.02)


@pytest.mark.parametrize("frame", ["relative", "moving"])
def test_predictors_see_the_same(pair: tuple[Dataset, Dataset], frame: str) -> None:
    windows = []
    for dataset in pair:
        records, settings = Records.of(dataset), WindowSettings(frame=frame)  # type: ignore[arg-type]
        windows.append(cut(records, draw_ends(records, settings, "test", per_record=2), settings))
    near, far = windows
    assert len(near) > 20
    np.testing.assert_allclose(far.tv, near.tv, rtol=0, atol=1e-4)
    np.testing.assert_allclose(far.uv, near.uv, rtol=0, atol=1e-4)


def test_windows_on_the_map_and_in_the_absolute_frame_are_in_the_plane(pair: tuple[Dataset, Dataset]) -> None:
    placed: list[OnMap] = []
    for dataset in pair:
        records, settings = Records.of(dataset), WindowSettings(frame="absolute")
        windows = cut(records, draw_ends(records, settings, "test"), settings)
        assert windows.on_map is not None
        np.testing.assert_allclose(windows.tv, windows.on_map.tv, rtol=0, atol=0.005)
        placed.append(windows.on_map)
    near, far = placed
    np.testing.assert_allclose(far.tv[:, :2] - near.tv[:, :2], FAR_M, rtol=0, atol=1e-4)
    offsets = [
        on_map.lane_maps("road").place(on_map.tv[:, :2, -1], on_map.tv[:, 2:4, -1]).offset_m for on_map in (near, far)
    ]
    np.testing.assert_allclose(*offsets, rtol=0, atol=1e-4)


def test_roads_are_stored_where_they_are(pair: tuple[Dataset, Dataset]) -> None:
    near, far = pair
    for here, there in zip(near.roads("road"), far.roads("road"), strict=True):
        np.testing.assert_allclose(there.shape - here.shape, FAR_M, rtol=0, atol=1e-9)


def test_sensed_anew_by_its_own_settings_the_states_are_the_same(pair: tuple[Dataset, Dataset], tmp_path: Path) -> None:
    _, far = pair
    again = resense(far, ResenseSettings(sensing=own_sensing(far)), tmp_path / "again", InlineEngine())
    again.verify()
    assert again.digest != ""
    np.testing.assert_array_equal(again.arrays("tv")["tv"], far.arrays("tv")["tv"])
    assert again.frame(["x0", "y0"]).equals(far.frame(["x0", "y0"]))
    true = resense(far, ResenseSettings(sensor="truth"), tmp_path / "true", InlineEngine())
    np.testing.assert_array_equal(true.arrays("tv")["tv"], far.arrays("tv_truth")["tv_truth"])


def test_a_point_is_added_to_positions_alone() -> None:
    states = np.arange(24, dtype=np.float32).reshape(2, 6, 2)
    placed = in_plane(states, np.array([100.0, 200.0]), np.array([-100.0, 0.0]))
    np.testing.assert_array_equal(placed[:, 0] - states[:, 0], [[100.0, 100.0], [200.0, 200.0]])
    np.testing.assert_array_equal(placed[:, 1] - states[:, 1], [[-100.0, -100.0], [0.0, 0.0]])
    np.testing.assert_array_equal(placed[:, 2:], states[:, 2:])
    np.testing.assert_array_equal(in_plane(states[0], 100.0, -100.0), placed[0])
