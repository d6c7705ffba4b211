"""Sensing a dataset anew: the same bytes by its own settings, what other settings change, and repeats."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from command_line.arguments import SenseArguments, resense_settings
from isacsim.errors import InputError
from isacsim.parsing import channel
from isacsim.sensing import SensingSettings
from labeling.dataset.dataset import Dataset, Shard
from labeling.dataset.shard import Episode
from labeling.dataset.summary import summary
from labeling.generation.engine import LocalEngine
from labeling.generation.generate import generate
from labeling.generation.log import LOG_FILE
from labeling.generation.resense import ResenseSettings, own_sensing, plan, resense
from tests.support.recorded_feedback import RecordedFeedback
from tests.support.scripted import InlineEngine, ScriptedSource, small_study

INLINE = InlineEngine()
SAME = ("scenario", "seed", "tv_id", "uv_id", "intention", "origin", "t_start", "t_onset", "t_commit", "t_end")
Anew = Callable[..., Dataset]


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    source = ScriptedSource(tmp_path_factory.mktemp("road"))
    study = small_study(seeds={"first": 1, "last": 3}, sensing={"channel": {"kind": "fixed", "snr_db": 0.0}})
    return generate(study, tmp_path_factory.mktemp("made") / "data", INLINE, source=source)


@pytest.fixture
def anew(dataset: Dataset, tmp_path: Path) -> Anew:
    """Senses the dataset by arguments of the command line, into a folder of its own, and checks the contract."""

    def sensed(sensor: str = "isac", **arguments: object) -> Dataset:
        settings = resense_settings(dataset, SenseArguments(sensor, **arguments))  # type: ignore[arg-type]
        made = resense(dataset, settings, tmp_path / f"{sensor}-{len(list(tmp_path.iterdir()))}", INLINE)
        made.verify()
        return made

    return sensed


def bytes_of(folder: Path) -> dict[str, bytes]:
    """Every file of a dataset but its log, which tells the time that each shard took."""
    files = (path for path in sorted(folder.rglob("*")) if path.is_file() and path.name != LOG_FILE)
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}


def position_error_m(dataset: Dataset) -> float:
    arrays = dataset.arrays("tv", "tv_truth")
    return float(np.median(np.hypot(*np.moveaxis(arrays["tv"] - arrays["tv_truth"], 1, 0)[:2])))


def test_own_settings_give_the_same_records_to_the_bit(dataset: Dataset, anew: Anew) -> None:
    made = anew()
    for name, values in dataset.arrays("tv", "tv_truth", "uv").items():
        np.testing.assert_array_equal(made.arrays(name)[name], values)
    assert made.frame().equals(dataset.frame())
    assert made.meta.left_out() == dataset.meta.left_out()
    assert made.meta.scenarios == dataset.meta.scenarios
    roads = Path("roads/road.parquet")
    assert (made.path / roads).read_bytes() == (dataset.path / roads).read_bytes()
    assert summary(made)["position_error_m"] == summary(dataset)["position_error_m"]


def test_other_settings_change_what_is_sensed_alone(dataset: Dataset, anew: Anew) -> None:
    loud, quiet = anew(snr="20"), anew(snr="-20:-10")
    for made in (loud, quiet):
        assert made.frame()[list(SAME)].equals(dataset.frame()[list(SAME)])
        np.testing.assert_array_equal(made.arrays("tv_truth")["tv_truth"], dataset.arrays("tv_truth")["tv_truth"])
    assert (loud.frame()["snr_db"] == 20).all()
    assert quiet.frame()["snr_db"].between(-20, -10).all()
    assert quiet.frame()["snr_db"].is_unique
    assert position_error_m(loud) < position_error_m(dataset) < position_error_m(quiet)
    assert own_sensing(loud).channel.snr_db == 20.0
    assert loud.meta.resensed is not None
    assert loud.meta.resensed["of"] == dataset.digest


def test_every_argument_reaches_its_setting(dataset: Dataset, anew: Anew) -> None:
    grid = anew(estimator="grid", fusion="eq5-covariance", sites=3, rain_mm_per_h=50.0)
    sensing = own_sensing(grid)
    assert (sensing.estimator, sensing.view.sites, sensing.channel.rain_mm_per_h) == ("grid", 3, 50.0)
    assert (sensing.fusion.method, sensing.fusion.eq5_weights) == ("eq5", "covariance")
    assert sensing.channel.kind == "fixed"
    assert (grid.frame()["n_sites"] <= 3).all()
    assert (grid.frame()["snr_db"] < 0.0).all()
    assert position_error_m(grid) > 10 * position_error_m(dataset)


def test_snr_by_the_link_budget_falls_with_the_distance(dataset: Dataset, anew: Anew) -> None:
    """All sites stand 150 m beside the road: by the radar equation 13 dB there for 11 dBsm, less along the road."""
    found = anew(snr="link").frame()["snr_db"]
    assert found.is_unique
    assert -15 < found.min() < found.max() < 25


def test_the_truth_is_a_sensor_without_error(anew: Anew) -> None:
    made = anew("truth")
    arrays, frame = made.arrays("tv", "tv_truth"), made.frame()
    np.testing.assert_array_equal(arrays["tv"], arrays["tv_truth"])
    assert set(frame["sensor"]) == {"truth"}
    assert (frame["n_sites"] == 0).all()
    found = summary(made)
    assert (found["snr_db"], found["position_error_m"]) == (None, {"before_filter": None, "sensed": 0.0})


def test_the_onboard_radar_sees_from_the_uv(anew: Anew) -> None:
    clear, weather = anew("radar"), anew("radar", radar="weather")
    assert set(clear.frame()["sensor"]) == {"radar"}
    assert (clear.frame()["n_sites"] == 0).all()
    assert clear.meta.study["sensing"]["channel"]["kind"] == "fixed"
    # 40 m away, 0.4 m of range and 0.3 degrees of azimuth a cycle: decimetres after the filter.
    assert position_error_m(clear) < 0.3
    paired = weather.frame()["snr_db"].to_numpy() - clear.frame()["snr_db"].to_numpy()
    np.testing.assert_allclose(paired, -20.0, atol=1e-3)
    assert position_error_m(anew("radar", radar="nlos", pattern="contiguous")) > position_error_m(clear)


def test_records_that_the_sensor_cannot_use_are_left_out_and_counted(dataset: Dataset, anew: Anew) -> None:
    made = anew(sites=1)
    assert len(made) == 0
    before = dataset.meta.left_out().get("too_few_sites", 0)
    assert made.meta.left_out()["too_few_sites"] == before + len(dataset)


def test_repeats_have_echoes_of_their_own(dataset: Dataset, anew: Anew, tmp_path: Path) -> None:
    own, extra = len(dataset), 2
    made = anew(records=2 * own + extra)
    frame, tv = made.frame(), made.arrays("tv")["tv"]
    assert len(made) == 2 * own + extra
    assert frame["sample_id"].is_unique
    turn = frame["sample_id"].str.partition("-r")[2]
    np.testing.assert_array_equal(tv[(turn == "").to_numpy()], dataset.arrays("tv")["tv"])
    first = dataset.frame()["sample_id"].iloc[0]
    of_first = frame["sample_id"].str.fullmatch(f"{first}(-r[0-9]+)?").to_numpy()
    assert list(frame["sample_id"][of_first]) == [first, f"{first}-r1", f"{first}-r2"]
    assert len(np.unique(tv[of_first], axis=0)) == 3
    # Sensed once more, a repeat is the same repeat.
    again = resense(made, resense_settings(made, SenseArguments("isac")), tmp_path / "again", INLINE)
    np.testing.assert_array_equal(again.arrays("tv")["tv"], tv)
    with pytest.raises(InputError, match="repeats records already"):
        resense(made, resense_settings(made, SenseArguments("isac", records=99)), tmp_path / "more", INLINE)


@pytest.mark.parametrize("records", [1, 3, 7, 8, 30])
def test_a_plan_fills_the_number_asked_for(records: int) -> None:
    shards = [
        Shard(
            file=f"a-{k}.parquet", sha256="0" * 64, bytes=1, samples=samples, by_intention={}, by_origin={},
            episode=Episode(scenario="a", seed=k),
        )
        for k, samples in enumerate((3, 0, 4))
    ]  # fmt: skip
    jobs = plan(shards, records)
    assert sum(job.records for job in jobs) == records
    assert [job.records for job in plan(shards, None)] == [3, 0, 4]
    counts = np.concatenate([np.arange(job.shard.samples) < job.more for job in jobs]) + jobs[0].times
    assert (np.diff(counts.astype(int)) <= 0).all()
    assert counts.max() - counts.min() <= 1


def test_more_jobs_make_the_same_bytes_and_what_stands_is_kept(dataset: Dataset, anew: Anew, tmp_path: Path) -> None:
    made = anew(snr="3", records=10)
    settings = resense_settings(dataset, SenseArguments("isac", snr="3", records=10))
    folder = tmp_path / "again"
    resense(dataset, settings, folder, LocalEngine(2))
    assert bytes_of(folder) == bytes_of(made.path)
    kept = folder / "shards/road-1.parquet"
    before = kept.stat().st_ino
    (folder / "shards/road-2.parquet").unlink()
    (folder / "shards/road-3.parquet").write_bytes(b"PAR1")

    feedback = RecordedFeedback()
    resense(dataset, settings, folder, INLINE, feedback)
    assert bytes_of(folder) == bytes_of(made.path)
    assert kept.stat().st_ino == before
    assert feedback.moves[0][0] > 0
    assert feedback.moves[-1] == (10, 10)


def test_a_folder_is_held_for_one_way_of_sensing(dataset: Dataset, tmp_path: Path) -> None:
    folder = tmp_path / "data"
    resense(dataset, resense_settings(dataset, SenseArguments("isac")), folder, INLINE)
    with pytest.raises(InputError, match=r"holds the dataset of another study \(resensed.settings.sensor is \"isac\""):
        resense(dataset, resense_settings(dataset, SenseArguments("truth")), folder, INLINE)
    with pytest.raises(InputError, match="choose another folder"):
        resense(dataset, ResenseSettings(), dataset.path, INLINE)


def test_damage_of_the_dataset_is_told(dataset: Dataset, tmp_path: Path) -> None:
    copy = resense(dataset, ResenseSettings(sensor="truth"), tmp_path / "copy", INLINE)
    shard = copy.shard_path(copy.meta.shards[0])
    shard.write_bytes(shard.read_bytes()[:-100])
    with pytest.raises(InputError, match=shard.name):
        resense(copy, ResenseSettings(), tmp_path / "out", INLINE)


def test_other_vehicles_are_not_in_a_dataset(dataset: Dataset, tmp_path: Path) -> None:
    blocked = SensingSettings.model_validate({"channel": {"blockage": True}})
    with pytest.raises(InputError, match="--no-blockage"):
        resense(dataset, ResenseSettings(sensing=blocked), tmp_path / "out", INLINE)
    with pytest.raises(InputError, match="choose random or contiguous"):
        resense(
            dataset,
            resense_settings(dataset, SenseArguments("radar", radar="nlos", pattern="line_of_sight")),
            tmp_path / "out",
        )
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("text", "content"),
    [
        ("link", {"kind": "link"}),
        ("-3.5", {"kind": "fixed", "snr_db": -3.5}),
        ("-5:5", {"kind": "uniform", "snr_range_db": (-5.0, 5.0)}),
    ],
)
def test_snr_is_a_range_a_value_or_a_link_budget(text: str, content: dict[str, object]) -> None:
    assert channel(text) == content


@pytest.mark.parametrize("text", ["loud", "5:", "1:2:3", "9:3", "nan:1", ""])
def test_snr_that_is_none_is_refused(text: str) -> None:
    with pytest.raises(InputError, match=r"--snr .*: is not a range"):
        channel(text)
