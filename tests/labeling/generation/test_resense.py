"""Sensing a dataset anew: the same bytes by its own settings, what other settings change, and repeats."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from isac_cosim.base.errors import InputError
from isac_cosim.base.parsing import channel
from isac_cosim.base.workers.kept_workers import KeptWorkers
from isac_cosim.command_line.arguments import SenseArguments, resense_settings
from isac_cosim.isacsim.sensing.chain import SensingSettings
from isac_cosim.isacsim.sensing.onboard_radar import RadarSettings
from isac_cosim.labeling.dataset.dataset import Dataset, Shard, ShardIndex
from isac_cosim.labeling.dataset.record_point import in_plane
from isac_cosim.labeling.dataset.shard import Episode
from isac_cosim.labeling.dataset.summary import summary
from isac_cosim.labeling.generation.generate import generate
from isac_cosim.labeling.generation.log import LOG_FILE
from isac_cosim.labeling.generation.resense import ResenseSettings, _carrier, own_report, own_sensing, plan, resense
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

    def sense_anew(sensor: str = "isac", **arguments: object) -> Dataset:
        settings = resense_settings(dataset, SenseArguments(sensor, **arguments))  # type: ignore[arg-type]
        sensed = resense(dataset, settings, tmp_path / f"{sensor}-{len(list(tmp_path.iterdir()))}", INLINE)
        sensed.verify()
        return sensed

    return sense_anew


def bytes_of(folder: Path) -> dict[str, bytes]:
    """Every file of a dataset but its log, which tells the time that each shard took."""
    files = (path for path in sorted(folder.rglob("*")) if path.is_file() and path.name != LOG_FILE)
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}


def position_error_m(dataset: Dataset) -> float:
    arrays = dataset.arrays("tv", "tv_truth")
    return float(np.median(np.hypot(*np.moveaxis(arrays["tv"] - arrays["tv_truth"], 1, 0)[:2])))


def test_own_settings_give_the_same_records_to_the_bit(dataset: Dataset, anew: Anew) -> None:
    sensed = anew()
    for name, values in dataset.arrays("tv", "tv_truth", "uv").items():
        np.testing.assert_array_equal(sensed.arrays(name)[name], values)
    assert sensed.frame().equals(dataset.frame())
    assert sensed.meta.left_out() == dataset.meta.left_out()
    assert sensed.meta.scenarios == dataset.meta.scenarios
    roads = Path("roads/road.parquet")
    assert (sensed.path / roads).read_bytes() == (dataset.path / roads).read_bytes()
    assert summary(sensed)["position_error_m"] == summary(dataset)["position_error_m"]


def test_other_settings_change_what_is_sensed_alone(dataset: Dataset, anew: Anew) -> None:
    loud, quiet = anew(snr="20"), anew(snr="-20:-10")
    for sensed in (loud, quiet):
        assert sensed.frame()[list(SAME)].equals(dataset.frame()[list(SAME)])
        np.testing.assert_array_equal(sensed.arrays("tv_truth")["tv_truth"], dataset.arrays("tv_truth")["tv_truth"])
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
    """All sites stand 150 m beside the road, where 11.25 dBsm give 16 dB; along the road it is less."""
    snr_db = anew(snr="link").frame()["snr_db"]
    assert snr_db.is_unique
    assert -15 < snr_db.min() < snr_db.max() < 25


def test_the_truth_is_a_sensor_without_error(anew: Anew) -> None:
    sensed = anew("truth")
    arrays, frame = sensed.arrays("tv", "tv_truth"), sensed.frame()
    np.testing.assert_array_equal(arrays["tv"], arrays["tv_truth"])
    assert set(frame["sensor"]) == {"truth"}
    assert (frame["n_sites"] == 0).all()
    figures = summary(sensed)
    assert (figures["snr_db"], figures["position_error_m"]) == (None, {"before_filter": None, "sensed": 0.0})


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
    sensed = anew(sites=1)
    assert len(sensed) == 0
    before = dataset.meta.left_out().get("too_few_sites", 0)
    assert sensed.meta.left_out()["too_few_sites"] == before + len(dataset)


def test_repeats_have_echoes_of_their_own(dataset: Dataset, anew: Anew, tmp_path: Path) -> None:
    stored, extra = len(dataset), 2
    sensed = anew(records=2 * stored + extra)
    frame, tv = sensed.frame(), sensed.arrays("tv")["tv"]
    assert len(sensed) == 2 * stored + extra
    assert frame["sample_id"].is_unique
    turn = frame["sample_id"].str.partition("-r")[2]
    np.testing.assert_array_equal(tv[(turn == "").to_numpy()], dataset.arrays("tv")["tv"])
    first = dataset.frame()["sample_id"].iloc[0]
    of_first = frame["sample_id"].str.fullmatch(f"{first}(-r[0-9]+)?").to_numpy()
    assert list(frame["sample_id"][of_first]) == [first, f"{first}-r1", f"{first}-r2"]
    assert len(np.unique(tv[of_first], axis=0)) == 3
    # Sensed once more, a repeat is the same repeat.
    again = resense(sensed, resense_settings(sensed, SenseArguments("isac")), tmp_path / "again", INLINE)
    np.testing.assert_array_equal(again.arrays("tv")["tv"], tv)
    with pytest.raises(InputError, match="repeats records already"):
        resense(sensed, resense_settings(sensed, SenseArguments("isac", records=99)), tmp_path / "more", INLINE)


@pytest.mark.parametrize("records", [1, 3, 7, 8, 30])
def test_a_plan_gives_the_number_of_records_wanted(records: int) -> None:
    shards = ShardIndex.of(
        Shard(
            file=f"a-{k}.parquet", sha256="0" * 64, bytes=1, samples=samples, by_intention={"following": samples},
            by_origin={"natural": samples},
            episode=Episode(scenario="a", seed=k),
        )
        for k, samples in enumerate((3, 0, 4))
    )  # fmt: skip
    jobs = plan(shards, records)
    assert sum(job.records for job in jobs) == records
    assert [job.records for job in plan(shards, None)] == [3, 0, 4]
    counts = np.concatenate([np.arange(job.shard.samples) < job.more for job in jobs]) + jobs[0].times
    assert (np.diff(counts.astype(int)) <= 0).all()
    assert counts.max() - counts.min() <= 1


@pytest.mark.slow
def test_more_jobs_make_the_same_bytes_and_what_stands_is_kept(
    dataset: Dataset, anew: Anew, tmp_path: Path, two_workers: KeptWorkers
) -> None:
    sensed = anew(snr="3", records=10)
    settings = resense_settings(dataset, SenseArguments("isac", snr="3", records=10))
    folder = tmp_path / "again"
    resense(dataset, settings, folder, two_workers)
    assert bytes_of(folder) == bytes_of(sensed.path)
    kept = folder / "shards/road-1.parquet"
    before = kept.stat().st_ino
    (folder / "shards/road-2.parquet").unlink()
    (folder / "shards/road-3.parquet").write_bytes(b"PAR1")
    feedback = RecordedFeedback()
    resense(dataset, settings, folder, INLINE, feedback)
    assert bytes_of(folder) == bytes_of(sensed.path)
    assert kept.stat().st_ino == before
    assert feedback.moves[0][0] > 0
    assert feedback.moves[-1] == (10, 10)


def test_workers_in_another_folder_find_the_dataset(
    dataset: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As those of a cluster, where the dataset was named relative to the command's folder."""
    (tmp_path / "elsewhere").mkdir()

    class Elsewhere(InlineEngine):
        def run(self, *arguments: Any) -> Iterator[Any]:  # type: ignore[override]
            monkeypatch.chdir(tmp_path / "elsewhere")
            yield from super().run(*arguments)
            monkeypatch.chdir(dataset.path.parent)

    monkeypatch.chdir(dataset.path.parent)
    settings = ResenseSettings(sensor="truth")
    anew = resense(Dataset.open(dataset.path.name), settings, tmp_path / "anew", Elsewhere())
    assert len(anew) == len(dataset)


def test_a_folder_is_held_for_one_way_of_sensing(dataset: Dataset, tmp_path: Path) -> None:
    folder = tmp_path / "data"
    resense(dataset, resense_settings(dataset, SenseArguments("isac")), folder, INLINE)
    with pytest.raises(InputError, match=r"holds the dataset of another study \(resensed.settings.sensor is \"isac\""):
        resense(dataset, resense_settings(dataset, SenseArguments("truth")), folder, INLINE)
    with pytest.raises(InputError, match="choose another folder"):
        resense(dataset, ResenseSettings(), dataset.path, INLINE)


def test_damage_of_the_dataset_is_reported(dataset: Dataset, tmp_path: Path) -> None:
    copy = resense(dataset, ResenseSettings(sensor="truth"), tmp_path / "copy", INLINE)
    shard = copy.shard_path(copy.meta.shards[0])
    shard.write_bytes(shard.read_bytes()[:-100])
    with pytest.raises(InputError, match=shard.name):
        resense(copy, ResenseSettings(), tmp_path / "out", INLINE)


FORMER = {
    "waveform": {
        "carrier_hz": 3.5e9, "subcarrier_spacing_hz": 3e4, "symbol_s": 0.5e-3 / 14, "subcarriers": 128, "symbols": 42,
        "antennas": 8, "spacing_wavelengths": 0.5,
    },
    "view": {"sites": 4, "range_m": 400.0, "half_width_deg": 60.0, "speed_mps": 100.0, "hold_s": 0.1},
    "channel": {
        "kind": "link", "snr_db": 5.0, "snr_range_db": [0.0, 10.0], "rain_mm_per_h": 0.0, "blockage": False,
        "link": {
            "power_dbm": 29.8, "transmit_gain_db": 8.0, "element_gain_db": 8.0, "noise_figure_db": 5.0, "loss_db": 3.0,
            "cross_section_dbsm": 11.25, "cross_section_sd_db": 3.41,
        },
    },
    "echo": "window", "device": "cpu", "estimator": "ml", "false_alarm": 0.001, "target_height_m": 0.8,
    "fusion": {"method": "information", "steps": 2, "eq5_weights": "paper", "speed_prior_mps": 60.0},
    "tracking": {
        "jerk_density": 10.0, "start_acceleration_mps2": 4.0, "gate": 1000.0, "reacquire_s": 0.1, "prelude_s": 0.5,
    },
}  # fmt: skip
"""Sensing settings as `dataset.json` of schema 1 holds them."""


def test_the_radar_rides_on_the_true_uv(dataset: Dataset, tmp_path: Path) -> None:
    """The noise of the reports, drawn again, leaves the motion that a UV without noise reports."""
    quiet = generate(
        small_study(
            seeds={"first": 1, "last": 1},
            sensing={"channel": {"kind": "fixed", "snr_db": 0.0}},
            report={"position_sd_m": 0, "speed_sd_mps": 0, "acceleration_sd_mps2": 0},
        ),
        tmp_path / "quiet",
        INLINE,
        source=ScriptedSource(tmp_path),
    )
    noisy = dataset.samples(dataset.meta.shards[0])
    silent = quiet.samples(quiet.meta.shards[0])
    truth = np.stack([in_plane(sample.uv, sample.x0, sample.y0) for sample in silent])
    carriers = [_carrier(sample, dataset.meta, own_report(dataset)) for sample in noisy]
    error = np.stack([carrier.reported for carrier in carriers if carrier.reported is not None]) - truth
    assert error[:, :2].std() == pytest.approx(0.02, rel=0.05)
    assert error[:, 2:4].std() == pytest.approx(0.05, rel=0.05)
    assert error[:, 4:].std() == pytest.approx(0.1, rel=0.05)
    np.testing.assert_allclose([carrier.state for carrier in carriers], truth, atol=2e-4)
    assert {(carrier.position_sd_m, carrier.speed_sd_mps) for carrier in carriers} == {(0.02, 0.05)}


def test_the_framework_radar_is_chosen_beside_its_condition(dataset: Dataset) -> None:
    arguments = SenseArguments("radar", radar="weather", radar_preset="framework")
    radar = resense_settings(dataset, arguments).radar
    assert (radar.condition, radar.cycle_s, radar.weather_factor) == ("weather", 0.0025, 10.0)
    assert resense_settings(dataset, SenseArguments("radar")).radar == RadarSettings()
    with pytest.raises(InputError, match="--radar-preset frame: no such radar; choose one of long_range, framework"):
        resense_settings(dataset, SenseArguments("radar", radar_preset="frame"))
    with pytest.raises(InputError, match="--radar-preset applies to the onboard radar only"):
        resense_settings(dataset, SenseArguments("isac", radar_preset="framework"))


def test_an_unknown_sensor_is_refused_by_name(dataset: Dataset) -> None:
    with pytest.raises(InputError, match="unknown sensor 'rader': did you mean radar"):
        resense_settings(dataset, SenseArguments("rader"))


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
