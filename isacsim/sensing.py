"""The sensing chain: a vehicle's true motion and the sites around it -> what the network knows of it, 6 x S.

Each record is sensed on its own: sites are assigned to it, every site's echo of every snapshot is drawn and estimated,
the estimates are fused into fixes, and a Kalman filter (all records together) turns fixes into states. Every draw is
seeded by the record's key, so a record comes out the same alone, in any company and in any order.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from pydantic import Field

from isacsim.arrays import Array, BoolArray, IntArray
from isacsim.errors import InputError
from isacsim.panels import Panels
from isacsim.radio.blockage import Blockers
from isacsim.radio.channel import ChannelSettings, snr_db
from isacsim.radio.estimation import Estimator, estimate_deviation, observe
from isacsim.radio.waveform import Waveform
from isacsim.scenarios.scenario import Site
from isacsim.seeding import stream
from isacsim.settings import Settings
from isacsim.tracking.fusion import Fixes, FusionSettings, fuse
from isacsim.tracking.fusion_tdoa_aoa import fuse_eq5
from isacsim.tracking.kalman import TrackingSettings, track

LEAST_SITES = 2
CONFIRMED = 0.25
"""Share of the snapshots before a record that must have located the vehicle: a false alarm or two are no vehicle."""
TOGETHER = 64
"""Records filtered at once: enough to make the filter cheap, few enough to keep their fixes' covariances small."""


class ViewSettings(Settings):
    """Which sites sense a vehicle."""

    sites: int = Field(4, ge=1, le=8, description="Sites used at once, at most.")
    range_m: float = Field(400.0, gt=0, description="Farthest vehicle a site senses.")
    half_width_deg: float = Field(60.0, gt=0, lt=90, description="A panel sees this far to either side of its azimuth.")
    speed_mps: float = Field(100.0, gt=0, description="Fastest radial speed taken for a vehicle's.")
    hold_s: float = Field(0.1, gt=0, description="The sites of a vehicle are chosen anew after this time.")


class SensingSettings(Settings):
    """The sensing chain of a study. The defaults are the paper's where it gives any."""

    waveform: Waveform = Field(default_factory=Waveform)
    view: ViewSettings = Field(default_factory=ViewSettings)
    channel: ChannelSettings = Field(default_factory=ChannelSettings)
    echo: Literal["window", "tensor"] = Field(
        "window", description="Draw what an estimate depends on (echo.py), or every number (echo_tensor.py, slow)."
    )
    device: str = Field("cpu", description="Where torch works on `tensor` echoes: cpu, cuda, cuda:1.")
    estimator: Estimator = Field("ml", description="Maximum likelihood, Candan's, the DFT's cell, the padded DFT's.")
    false_alarm: float = Field(
        1e-3,
        gt=0,
        lt=1,
        description="Probability that noise alone passes for an echo at a site and snapshot; an estimate "
        "whose power is below that level is not used.",
    )
    target_height_m: float = Field(0.8, ge=0, description="Height of the vehicle's reflecting point above the road.")
    fusion: FusionSettings = Field(default_factory=FusionSettings)
    tracking: TrackingSettings = Field(default_factory=TrackingSettings)


@dataclass(frozen=True)
class SensedRecord:
    """What the network knows of one record.

    state: x, y, vx, vy, ax, ay after the filter, (6, S). fixes: x, y, vx, vy before it, (4, S); where no echo was
    detected, the fix before is repeated. n_sites: sites assigned, the least over the record. snr_db: mean per-element
    SNR over the record and its sites. detected: share of the echoes that were detected.

    A record with n_sites below LEAST_SITES cannot be fused: it is not `usable`, and its state and fixes are all zero.
    n_sites is 0, too, where fewer than CONFIRMED of the snapshots before the record located the vehicle.
    """

    state: Array
    fixes: Array
    n_sites: int
    snr_db: float
    detected: float
    usable: bool


@dataclass(frozen=True)
class Observed:
    """Fixes of one record with its prelude, and what they rest on (see SensedRecord)."""

    fixes: Fixes
    n_sites: int
    snr_db: float
    detected: float


def sense(
    truth: Array,
    rate_hz: float,
    sites: Sequence[Site],
    settings: SensingSettings,
    keys: Sequence[tuple[str | int, ...]],
    blockers: Sequence[Blockers | None] | None = None,
) -> list[SensedRecord]:
    """Sense B records.

    truth: x, y, vx, vy, ax, ay of the reflecting point, m, m/s, m/s2, (B, 6, S) at rate_hz. keys: one a record.
    blockers: the other vehicles of each record, where the channel has blockage.
    Raises InputError where the truth does not fit the keys, there is no site, or blockage is asked without vehicles.
    """
    if truth.ndim != 3 or truth.shape[1] != 6 or truth.shape[0] != len(keys):
        raise InputError(
            f"truth of shape {truth.shape} for {len(keys)} keys: give (records, 6, snapshots), one key a record"
        )
    if not sites:
        raise InputError("no sites to sense with: add POIs of type isac_site to the scenario")
    others = blockers if blockers is not None else [None] * len(keys)
    records: list[SensedRecord] = []
    for begin in range(0, len(keys), TOGETHER):
        part = slice(begin, begin + TOGETHER)
        records += _sense_together(truth[part], rate_hz, sites, settings, keys[part], others[part])
    return records


def _sense_together(
    truth: Array,
    rate_hz: float,
    sites: Sequence[Site],
    settings: SensingSettings,
    keys: Sequence[tuple[str | int, ...]],
    blockers: Sequence[Blockers | None],
) -> list[SensedRecord]:
    """Sense a few records, whose fixes are held at once for the filter."""
    count = prelude_snapshots(rate_hz, settings.tracking)
    motion = np.concatenate([before(truth, rate_hz, count), truth], axis=2)
    observed = [fix(motion[k], rate_hz, sites, settings, key, blockers[k]) for k, key in enumerate(keys)]
    good = [k for k, item in enumerate(observed) if item.n_sites >= LEAST_SITES]
    states = np.zeros((len(keys), 6, truth.shape[2]))
    if good:
        tracks = track(
            np.stack([observed[k].fixes.state for k in good]),
            np.stack([observed[k].fixes.covariance for k in good]),
            np.stack([observed[k].fixes.valid for k in good]),
            1 / rate_hz,
            settings.tracking,
        )
        states[good] = tracks.state[:, count:].transpose(0, 2, 1)
    return [_record(item, states[k], count) for k, item in enumerate(observed)]


def _record(observed: Observed, state: Array, count: int) -> SensedRecord:
    return SensedRecord(
        state=state,
        fixes=np.ascontiguousarray(observed.fixes.state[count:].T),
        n_sites=observed.n_sites,
        snr_db=observed.snr_db,
        detected=observed.detected,
        usable=observed.n_sites >= LEAST_SITES,
    )


def prelude_snapshots(rate_hz: float, settings: TrackingSettings) -> int:
    """Snapshots sensed before a record begins."""
    return round(settings.prelude_s * rate_hz)


def before(truth: Array, rate_hz: float, count: int) -> Array:
    """The `count` snapshots before a record, its first state carried back at constant acceleration: (B, 6, count)."""
    time = (np.arange(count) - count) / rate_hz
    position, velocity, acceleration = (truth[:, k : k + 2, :1] for k in (0, 2, 4))
    return np.concatenate(
        [
            position + velocity * time + acceleration * time**2 / 2,
            velocity + acceleration * time,
            np.broadcast_to(acceleration, (*acceleration.shape[:2], count)),
        ],
        axis=1,
    )


def fix(
    motion: Array,
    rate_hz: float,
    sites: Sequence[Site],
    settings: SensingSettings,
    key: tuple[str | int, ...],
    blockers: Blockers | None = None,
) -> Observed:
    """Echoes, estimates and fixes of one record. motion: (6, S) at rate_hz, prelude included."""
    everyone = Panels.of(sites, settings.target_height_m)
    slots = assign(motion[:2].T, rate_hz, everyone, settings.view)
    assigned = slots >= 0
    n_sites = int(assigned.sum(axis=1).min())
    if n_sites < LEAST_SITES:
        return _unseen(motion.shape[1], n_sites)
    # An empty slot repeats the first site; what it measures is not used.
    number = np.where(assigned, slots, slots[:, :1])
    panels = everyone.take(number)
    true = panels.measured(motion[:4].T)
    prelude = prelude_snapshots(rate_hz, settings.tracking)
    time_s = (np.arange(motion.shape[1]) - prelude) / rate_hz
    level = snr_db(settings.channel, settings.waveform, motion[:2].T, number, panels, time_s, blockers, key)
    measured, deviation, power = _measure(true, level, settings, key)
    threshold = np.log(8 * settings.waveform.size / settings.false_alarm)
    used = assigned & (power > threshold) & plausible(measured, settings.view)
    method = fuse if settings.fusion.method == "information" else fuse_eq5
    fixes = filled(method(measured, deviation, used, panels, settings.fusion))
    if fixes.valid[: prelude + 1].mean() < CONFIRMED:
        return _unseen(motion.shape[1], 0)
    return Observed(fixes, n_sites, float(level[assigned].mean()), float(used.sum() / assigned.sum()))


def plausible(measured: Array, settings: ViewSettings) -> BoolArray:
    """Whether an estimate can be of a vehicle in view, (..., 3) -> (...): most peaks of noise lie elsewhere.

    The range may exceed the view's by a fifth: vehicles drive on between assignments, and a grid errs by half a cell.
    """
    return np.asarray((measured[..., 1] <= 1.2 * settings.range_m) & (np.abs(measured[..., 2]) <= settings.speed_mps))


def _unseen(count: int, n_sites: int) -> Observed:
    """What is known of a vehicle that cannot be located: nothing, at each of `count` snapshots."""
    fixes = Fixes(np.zeros((count, 4)), np.tile(np.eye(4), (count, 1, 1)), np.zeros(count, dtype=bool))
    return Observed(fixes, n_sites, 0.0, 0.0)


def _measure(
    true: Array, level_db: Array, settings: SensingSettings, key: tuple[str | int, ...]
) -> tuple[Array, Array, Array]:
    """Estimates of every echo: measured and deviation, (S, I, 3), and power, (S, I)."""
    waveform = settings.waveform
    cells = waveform.cells(true.reshape(-1, 3))
    snr = 10 ** (level_db.ravel() / 10)
    if settings.echo == "tensor":
        # Here, so that workers that draw by the window need not load torch.
        from isacsim.radio.echo_tensor import observe_tensor

        seed = int(stream(*key, "echo").integers(2**62))
        found = observe_tensor(cells, snr, settings.estimator, waveform, seed, settings.device)
    else:
        found = observe(cells, snr, settings.estimator, waveform, stream(*key, "echo"))
    deviation = estimate_deviation(found.power, settings.estimator, waveform) / np.abs(waveform.cells_per_unit)
    shape = true.shape
    return waveform.measured(found.cells).reshape(shape), deviation.reshape(shape), found.power.reshape(shape[:2])


def filled(fixes: Fixes) -> Fixes:
    """Fixes with the one before (at the start, the first one) in the place of each that is missing.

    Their covariance, and `valid`, still say that nothing was measured there.
    """
    latest = np.maximum.accumulate(np.where(fixes.valid, np.arange(len(fixes.valid)), -1))
    latest = np.where(latest < 0, int(np.argmax(fixes.valid)), latest)
    return Fixes(fixes.state[latest], fixes.covariance, fixes.valid)


def assign(position: Array, rate_hz: float, panels: Panels, settings: ViewSettings) -> IntArray:
    """The sites that sense a vehicle at each snapshot: numbers, nearest first, -1 where fewer see it, (S, I).

    position: true x, y, m, (S, 2). Chosen at the start of every `hold_s` among the panels that see the vehicle: the
    nearest ones, one a mast, since two panels of one mast share their line of sight.
    """
    hold = max(1, round(settings.hold_s * rate_hz))
    at = position[::hold]
    dx, dy, distance = panels.sight(at[:, :1], at[:, 1:])
    ahead = dx * panels.front[:, 0] + dy * panels.front[:, 1]
    seen = (distance <= settings.range_m) & (ahead >= np.hypot(dx, dy) * np.cos(np.radians(settings.half_width_deg)))
    _, mast = np.unique(np.round(np.stack([panels.x, panels.y], axis=1)), axis=0, return_inverse=True)
    # Both panels of a mast are equally far: the one that faces the vehicle more squarely comes first.
    order = np.lexsort((-ahead, np.round(distance, 3)), axis=1)
    chosen = np.full((len(at), settings.sites), -1)
    for row in range(len(at)):
        ranked = [int(k) for k in order[row] if seen[row, k]]
        nearest: dict[int, int] = {}
        for k in ranked:
            nearest.setdefault(int(mast[k]), k)
        best = list(nearest.values())[: settings.sites]
        chosen[row, : len(best)] = best
    return np.repeat(chosen, hold, axis=0)[: len(position)]
