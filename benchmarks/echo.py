"""Speed and accuracy of the sensing chain, all in one run on one thread.

- reference: numpy complex128, one snapshot at a time: tensor, noise, 3-D FFT, peak.
- window: the DFT block with maximum likelihood, SNR drawn from 0-10 dB. The key has the block's former name.
- window_threshold: the same at -25 dB, where the coarse search is drawn, too.
- tensor: the full tensor in torch with maximum likelihood; also on the GPU if there is one.
- record: processor time, s, of a 5 s record with four sites, that is 2,000 x 4 snapshots, fusion and filter; one alone,
  and each of 32 together.

Run: python -m isac_cosim.benchmarks.echo
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import torch

from isac_cosim.base.arrays import Array
from isac_cosim.base.files import json_text
from isac_cosim.base.workers.threads import torch_threads
from isac_cosim.benchmarks.ratios import Ratio
from isac_cosim.isacsim.radio.bounds import cell_bound
from isac_cosim.isacsim.radio.echo_tensor import observe_tensor
from isac_cosim.isacsim.radio.estimation import Estimates
from isac_cosim.isacsim.radio.estimators import ESTIMATORS
from isac_cosim.isacsim.radio.waveform import Waveform, steering
from isac_cosim.isacsim.scenarios.scenario import Site
from isac_cosim.isacsim.sensing.passages import Passage, WatchedTraffic
from isac_cosim.isacsim.sensing.sensors import DEFAULT, watch
from isac_cosim.isacsim.sensing.sensors.protocol import SensorSettings

SNR_RANGE_DB = (-25.0, -20.0, -10.0, 0.0, 10.0, 20.0)
RATE_HZ = 400.0
RATIOS = (
    Ratio(("ratio_window",), "snapshots a second: DFT block over numpy, one at a time", "drawing normal numbers"),
    Ratio(("ratio_window_threshold",), "the same at -25 dB, with the coarse search", "drawing and searching 216 cells"),
    Ratio(("ratio_tensor",), "snapshots a second: full tensor in torch over numpy", "memory bandwidth"),
)


def run() -> dict[str, Any]:
    """Measure everything; keys `snapshots_per_s`, `ratio_window`, `rmse_over_bound`, `record_s`, `reference`."""
    with torch_threads(1):
        return _measured()


def _measured() -> dict[str, Any]:
    waveform = Waveform()
    # Reference and block take turns, so that a busy machine slows both.
    rounds = [(_rate(_reference, 60, waveform), _rate(_block, 40_000, waveform)) for _ in range(5)]
    reference, block = (float(np.median(side)) for side in zip(*rounds, strict=True))
    speeds = {
        "reference": reference,
        "window": block,
        "window_threshold": _rate(_block_threshold, 4000, waveform),
        "tensor": _rate(_tensor, 160, waveform),
    }
    result: dict[str, Any] = {
        "reference": "numpy complex128, one snapshot at a time: tensor, noise, 3-D FFT, peak; one thread",
        "snapshots_per_s": speeds,
        "ratio_window": float(np.median([fast / slow for slow, fast in rounds])),
        "ratio_window_threshold": speeds["window_threshold"] / reference,
        "ratio_tensor": speeds["tensor"] / reference,
        "rmse_over_bound": {
            "window": _over_bound(_block_at, 20_000, waveform),
            "tensor": _over_bound(_tensor_at, 160, waveform),
        },
        "record_s": {"alone": record_s(1), "of_32": record_s(32)},
        "gpu": _gpu(waveform) if torch.cuda.is_available() else None,
    }
    return result


def _targets(count: int, seed: int) -> Array:
    """Targets anywhere in and between cells, within 390 m and 60 degrees of broadside, (count, 3) cells."""
    rng = np.random.default_rng(seed)
    return rng.uniform([-3.4, -10.0, -1.5], [3.4, -1.0, 1.5], (count, 3))


def _paper_snr(count: int) -> Array:
    return np.asarray(10 ** (np.random.default_rng(1).uniform(0, 1, count)))


def _rate(work: Callable[[int, Waveform], object], count: int, waveform: Waveform) -> float:
    """Snapshots per second of `work`, after one warm-up."""
    work(max(count // 20, 1), waveform)
    begin = time.perf_counter()
    work(count, waveform)
    return count / (time.perf_counter() - begin)


def _reference(count: int, waveform: Waveform) -> None:
    rng = np.random.default_rng(2)
    for place, snr in zip(_targets(count, 3), _paper_snr(count), strict=True):
        axes = [steering(place[k], n) for k, n in enumerate(waveform.shape)]
        echo = np.sqrt(snr) * axes[0][:, None, None] * axes[1][None, :, None] * axes[2][None, None, :]
        noise = rng.standard_normal(waveform.shape) + 1j * rng.standard_normal(waveform.shape)
        bins = np.fft.fftn(echo + np.sqrt(0.5) * noise)
        np.unravel_index(int(np.argmax(np.abs(bins))), waveform.shape)


def _block(count: int, waveform: Waveform) -> None:
    # A record's worth of snapshots at a time, as the chain does.
    rng = np.random.default_rng(4)
    for begin in range(0, count, 8000):
        size = min(8000, count - begin)
        ESTIMATORS["ml"].observe(_targets(size, begin), _paper_snr(size), waveform, rng)


def _block_threshold(count: int, waveform: Waveform) -> None:
    ESTIMATORS["ml"].observe(_targets(count, 5), np.full(count, 10**-2.5), waveform, np.random.default_rng(6))


def _tensor(count: int, waveform: Waveform) -> None:
    observe_tensor(_targets(count, 7), _paper_snr(count), ESTIMATORS["ml"], waveform, 8)


def _block_at(cells: Array, snr: Array, waveform: Waveform) -> Estimates:
    return ESTIMATORS["ml"].observe(cells, snr, waveform, np.random.default_rng(9))


def _tensor_at(cells: Array, snr: Array, waveform: Waveform) -> Estimates:
    return observe_tensor(cells, snr, ESTIMATORS["ml"], waveform, 10)


def _over_bound(
    estimate: Callable[[Array, Array, Waveform], Estimates], count: int, waveform: Waveform
) -> dict[str, list[float]]:
    """RMSE over the bound of angle, delay and Doppler at each SNR."""
    ratios = {}
    for snr_db in SNR_RANGE_DB:
        cells, snr = _targets(count, 11), np.full(count, 10 ** (snr_db / 10))
        error = estimate(cells, snr, waveform).cells - cells
        ratio = np.sqrt(np.mean(error**2, axis=0)) / cell_bound(snr[0], waveform)
        ratios[f"{snr_db:g} dB"] = [round(float(r), 4) for r in ratio]
    return ratios


def record_s(records: int) -> float:
    """Processor time of one 5 s record with four sites if `records` are sensed together, s; the best of three runs."""
    sites = [
        Site(f"{mast}-{azimuth}", -600 + 150.0 * mast, (-20.0, 20.0)[mast % 2], 25.0, azimuth)
        for mast in range(8)
        for azimuth in ((45.0, 315.0), (135.0, 225.0))[mast % 2]
    ]
    snapshots = np.arange(2000) / RATE_HZ
    truth = np.zeros((6, 2000))
    truth[0], truth[2] = 20 * snapshots, 20.0
    sensor = watch(DEFAULT, WatchedTraffic("bench", 0, sites, RATE_HZ), SensorSettings())
    spent = []
    for attempt in range(3):
        passages = [Passage("tv", 0.0, truth, ("bench", attempt, k)) for k in range(records)]
        begin = time.process_time()
        sensed = sensor.record(passages)
        spent.append((time.process_time() - begin) / records)
        if not all(record.n_sites == 4 for record in sensed):
            raise RuntimeError("the road of the benchmark leaves a record without four sites")
    return min(spent)


def _gpu(waveform: Waveform) -> dict[str, float]:
    """Snapshots per second of the full tensor on the first GPU."""
    count, batch = 16_384, 1024
    cells, snr = _targets(count, 12), _paper_snr(count)
    observe_tensor(cells[:batch], snr[:batch], ESTIMATORS["ml"], waveform, 13, "cuda", batch=batch)
    begin = time.perf_counter()
    observe_tensor(cells, snr, ESTIMATORS["ml"], waveform, 13, "cuda", batch=batch)
    torch.cuda.synchronize()
    return {"snapshots_per_s": count / (time.perf_counter() - begin)}


if __name__ == "__main__":
    print(json_text(run(), 2))
