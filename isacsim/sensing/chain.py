"""The sensing chain composed: from a vehicle's true motion and the sites around it to what the network knows of it.

Each record is sensed on its own. Sites are assigned to it; every site's echo is drawn and estimated at every snapshot;
the estimates of a snapshot are fused into a fix; and a Kalman filter turns the fixes into states, many records at a
time. The record's key seeds every draw, so a record comes out the same alone, with others, and in any order.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from isac_cosim.base.arrays import Array, BoolArray, IntArray
from isac_cosim.base.errors import InputError
from isac_cosim.base.seeding import stream
from isac_cosim.base.settings import Settings
from isac_cosim.isacsim.heading import heading_rad
from isac_cosim.isacsim.panels import Panels
from isac_cosim.isacsim.radio.blockage import Blockers
from isac_cosim.isacsim.radio.channel import ChannelSettings, EchoGeometry, snr_db
from isac_cosim.isacsim.radio.estimators import ESTIMATORS
from isac_cosim.isacsim.radio.waveform import Waveform
from isac_cosim.isacsim.scenarios.scenario import Site
from isac_cosim.isacsim.tracking.fusion import Fixes
from isac_cosim.isacsim.tracking.fusion_methods import FUSION_METHODS, FusionSettings
from isac_cosim.isacsim.tracking.kalman import TrackingSettings, track

LEAST_SITES = 2
"""Fewest sites that locate a vehicle."""
CONFIRMED = 0.25
"""Share of the snapshots before a record that must have located the vehicle: one or two false alarms are no vehicle."""
TOGETHER = 96
"""Records filtered at once: enough to make the filter cheap, few enough to keep their covariances small in memory."""


class ViewSettings(Settings):
    """Which sites sense a vehicle."""

    sites: int = Field(4, ge=1, le=8, description="Most sites used at once.")
    range_m: float = Field(
        350.0, gt=0, description="Farthest vehicle that a site senses; at most what the cyclic prefix carries."
    )
    half_width_deg: float = Field(60.0, gt=0, lt=90, description="A panel sees this far to either side of its azimuth.")
    speed_mps: float = Field(100.0, gt=0, description="Highest radial speed accepted as a vehicle's.")
    hold_s: float = Field(0.1, gt=0, description="Time after which the sites of a vehicle are chosen anew.")


def _current_name(value: Any) -> Any:
    """The present name of a way to draw echoes; files written before call the DFT block "window"."""
    return "block" if value == "window" else value


class SensingSettings(Settings):
    """The sensing chain of a study. The defaults are the paper's where it gives any."""

    waveform: Waveform = Field(default_factory=Waveform)
    view: ViewSettings = Field(default_factory=ViewSettings)
    channel: ChannelSettings = Field(default_factory=ChannelSettings)
    echo: Annotated[Literal["block", "tensor"], BeforeValidator(_current_name)] = Field(
        "block",
        description="Draw the DFT block, on which an estimate depends (echo.py), or the whole echo (echo_tensor.py, "
        "slow).",
    )
    device: str = Field("cpu", description="Where torch works on `tensor` echoes: cpu, cuda, cuda:1.")
    estimator: Annotated[str, AfterValidator(ESTIMATORS.check)] = Field(
        "ml", description="; ".join(f"{name}: {estimator.label}" for name, estimator in ESTIMATORS.items())
    )
    false_alarm: float = Field(
        1e-3,
        gt=0,
        lt=1,
        description="Probability that noise alone passes for an echo at a site and snapshot; an estimate whose power "
        "is below that level is not used.",
    )
    target_height_m: float = Field(0.8, ge=0, description="Height of the vehicle's reflecting point above the road.")
    fusion: FusionSettings = Field(default_factory=FusionSettings)
    tracking: TrackingSettings = Field(default_factory=TrackingSettings)

    @model_validator(mode="after")
    def _within_the_cyclic_prefix(self) -> Self:
        longest_m = self.waveform.longest_range_m
        if self.view.range_m > longest_m:
            raise ValueError(
                f"view.range_m {self.view.range_m:g} is beyond the {longest_m:.0f} m that waveform.cyclic_prefix_s "
                f"carries: lower it to {int(longest_m)}, or lengthen the prefix"
            )
        return self


@dataclass(frozen=True)
class SensedRecord:
    """What a sensor knows of one record.

    state: x, y, vx, vy, ax, ay after the filter, (6, S). fixes: x, y, vx, vy before it, (4, S); a snapshot without a
    detection repeats the fix before it. n_sites: fewest sites assigned at any snapshot; 0 for a sensor that uses none.
    snr_db: per-element SNR, mean over the record and its sites. detected: share of the echoes that were detected.
    usable: whether the sensor could follow the vehicle; otherwise state and fixes mean nothing.

    The sites cannot use a record that fewer than LEAST_SITES of them see throughout: its state and fixes are zero. A
    record that fewer than CONFIRMED of the snapshots before it located is not usable either, and its n_sites is 0.
    """

    state: Array
    fixes: Array
    n_sites: int
    snr_db: float
    detected: float
    usable: bool


@dataclass(frozen=True)
class Observed:
    """Fixes of one record, run-in included, and what they rest on (see SensedRecord)."""

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
    past: Array | None = None,
) -> list[SensedRecord]:
    """Sense B records with the sites.

    truth: x, y, vx, vy, ax, ay of the reflecting point, m, m/s, m/s2, (B, 6, S) at rate_hz. keys: one for each
    record, which seeds its draws. blockers: the other vehicles of each record, needed if the channel has blockage.
    past: true states just before the records, (B, 6, P) at rate_hz, for the filter's run-in (see `run_in`).
    Returns a SensedRecord for each record.
    Raises InputError if truth and keys do not fit, there is no site, or blockage is on without other vehicles.
    """
    if truth.ndim != 3 or truth.shape[1] != 6 or truth.shape[0] != len(keys):
        raise InputError(
            f"truth of shape {truth.shape} for {len(keys)} keys: give (records, 6, snapshots) and one key per record"
        )
    if not sites:
        raise InputError("no sites to sense with: add POIs of type isac_site to the scenario")
    others = blockers if blockers is not None else [None] * len(keys)
    records: list[SensedRecord] = []
    for begin in range(0, len(keys), TOGETHER):
        part = slice(begin, begin + TOGETHER)
        earlier = None if past is None else past[part]
        records += _sense_together(truth[part], rate_hz, sites, settings, keys[part], others[part], earlier)
    return records


def _sense_together(
    truth: Array,
    rate_hz: float,
    sites: Sequence[Site],
    settings: SensingSettings,
    keys: Sequence[tuple[str | int, ...]],
    blockers: Sequence[Blockers | None],
    past: Array | None,
) -> list[SensedRecord]:
    """Sense the records of one pass of the filter."""
    count = run_in_snapshots(rate_hz, settings.tracking)
    motion = np.concatenate([run_in(truth, rate_hz, count, past), truth], axis=2)
    known = 0 if past is None else min(past.shape[2], count)
    observed = [fix(motion[k], rate_hz, sites, settings, key, blockers[k], known) for k, key in enumerate(keys)]
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


def run_in_snapshots(rate_hz: float, settings: TrackingSettings) -> int:
    """Number of snapshots in the filter's run-in, which are sensed before a record begins."""
    return round(settings.run_in_s * rate_hz)


def run_in(truth: Array, rate_hz: float, count: int, past: Array | None = None) -> Array:
    """The motion in the run-in of B records: their true past, and what is not known of it carried back.

    truth: (B, 6, S) at rate_hz. count: snapshots of the run-in. past: true states just before the records, (B, 6, P),
    where they are known. Returns (B, 6, count).
    """
    if past is None or not past.shape[2] or not count:
        return before(truth, rate_hz, count)
    known = past[:, :, -count:]
    return np.concatenate([before(known, rate_hz, count - known.shape[2]), known], axis=2)


def before(truth: Array, rate_hz: float, count: int) -> Array:
    """The motion before B records: their first state carried back at constant acceleration.

    truth: (B, 6, S) at rate_hz. count: snapshots to go back. Returns (B, 6, count).
    """
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
    known: int = 0,
) -> Observed:
    """Draw the echoes of one record, estimate from them, and fuse the estimates.

    motion: true x, y, vx, vy, ax, ay, (6, S) at rate_hz, run-in included. key: seeds the draws. known: snapshots of the
    run-in, the last ones, that are the vehicle's true past; the others are carried back.
    Returns the fixes of all S snapshots.
    """
    all_panels = Panels.of(sites, settings.target_height_m)
    slots = assign(motion[:2].T, rate_hz, all_panels, settings.view)
    assigned = slots >= 0
    n_sites = int(assigned.sum(axis=1).min())
    if n_sites < LEAST_SITES:
        return _unseen(motion.shape[1], n_sites)
    # An empty slot repeats the first site; what it measures is not used.
    number = np.where(assigned, slots, slots[:, :1])
    panels = all_panels.take(number)
    count = run_in_snapshots(rate_hz, settings.tracking)
    geometry = EchoGeometry(
        position=motion[:2].T,
        heading_rad=_heading_rad(motion, count - known),
        site=number,
        panels=panels,
        time_s=(np.arange(motion.shape[1]) - count) / rate_hz,
    )
    level = snr_db(settings.channel, settings.waveform, geometry, blockers, key)
    fixes, used = fused(motion[:4].T, assigned, panels, level, settings, key)
    fixes = filled(fixes)
    if fixes.valid[: count + 1].mean() < CONFIRMED:
        return _unseen(motion.shape[1], 0)
    return Observed(fixes, n_sites, float(level[assigned].mean()), float(used.sum() / assigned.sum()))


def fused(
    states: Array,
    assigned: BoolArray,
    panels: Panels,
    level_db: Array,
    settings: SensingSettings,
    key: tuple[str | int, ...],
) -> tuple[Fixes, BoolArray]:
    """Draw the echoes of S snapshots at I panels, estimate from them, and fuse the estimates that are used.

    states: true x, y, vx, vy, (S, 4). assigned, panels, level_db: whether a slot has a panel, that panel, and the SNR
    of its echo, dB, each (S, I). key: seeds the draws. Returns the fixes, and which echoes they rest on, (S, I).
    """
    measured, deviation, power = _measure(panels.measured(states), level_db, settings, key)
    threshold = np.log(8 * settings.waveform.size / settings.false_alarm)
    used = assigned & (power > threshold) & plausible(measured, settings.view)
    return FUSION_METHODS[settings.fusion.method](measured, deviation, used, panels, settings.fusion), used


def _heading_rad(motion: Array, carried: int) -> Array:
    """Heading of the vehicle at each snapshot, (S,): during the first `carried` snapshots, that of the next one.

    Motion carried back has no heading of its own: a vehicle that drives off would have come in reverse.
    """
    heading = heading_rad(motion[2:4, carried:])
    return np.concatenate([np.full(carried, heading[0]), heading])


def plausible(measured: Array, settings: ViewSettings) -> BoolArray:
    """Whether estimates can be of a vehicle in view; most peaks of noise cannot.

    measured: sine, range (m), radial velocity (m/s), (..., 3). Returns (...). The range may exceed the view's by a
    fifth: vehicles drive on between assignments, and a grid errs by half a cell.
    """
    return np.asarray((measured[..., 1] <= 1.2 * settings.range_m) & (np.abs(measured[..., 2]) <= settings.speed_mps))


def _unseen(count: int, n_sites: int) -> Observed:
    """The observation of a vehicle that cannot be located: no fix at any of `count` snapshots."""
    fixes = Fixes(np.zeros((count, 4)), np.tile(np.eye(4), (count, 1, 1)), np.zeros(count, dtype=bool))
    return Observed(fixes, n_sites, 0.0, 0.0)


def _measure(
    true: Array, level_db: Array, settings: SensingSettings, key: tuple[str | int, ...]
) -> tuple[Array, Array, Array]:
    """Draw and estimate every echo: measured values and their deviations, (S, I, 3), and power, (S, I)."""
    waveform = settings.waveform
    cells = waveform.cells(true.reshape(-1, 3))
    snr = 10 ** (level_db.ravel() / 10)
    estimator = ESTIMATORS[settings.estimator]
    if settings.echo == "tensor":
        # Imported here, so that workers that draw DFT blocks need not load torch.
        from isac_cosim.isacsim.radio.echo_tensor import observe_tensor

        seed = int(stream(*key, "echo").integers(2**62))
        estimates = observe_tensor(cells, snr, estimator, waveform, seed, settings.device)
    else:
        estimates = estimator.observe(cells, snr, waveform, stream(*key, "echo"))
    deviation = estimator.deviation(estimates.power, waveform) / np.abs(waveform.cells_per_unit)
    measured, shape = waveform.measured(estimates.cells), true.shape
    return measured.reshape(shape), deviation.reshape(shape), estimates.power.reshape(shape[:2])


def filled(fixes: Fixes) -> Fixes:
    """Fill missing fixes with the latest one before them, or, at the start, with the first one.

    Covariance and `valid` stay as they are, and so still say that nothing was measured there.
    """
    latest = np.maximum.accumulate(np.where(fixes.valid, np.arange(len(fixes.valid)), -1))
    latest = np.where(latest < 0, int(np.argmax(fixes.valid)), latest)
    return Fixes(fixes.state[latest], fixes.covariance, fixes.valid)


def assign(position: Array, rate_hz: float, panels: Panels, settings: ViewSettings) -> IntArray:
    """Choose the sites that sense a vehicle at each snapshot.

    At the start of every `hold_s`, the nearest panels that see the vehicle are chosen, one on each mast: two panels
    on one mast share their line of sight.
    position: true x, y, m, (S, 2) at rate_hz. panels: of all sites.
    Returns numbers of sites, nearest first, -1 where fewer see the vehicle, (S, settings.sites).
    """
    hold = max(1, round(settings.hold_s * rate_hz))
    at = position[::hold]
    dx, dy, distance = panels.sight(at[:, :1], at[:, 1:])
    ahead = dx * panels.front[:, 0] + dy * panels.front[:, 1]
    seen = (distance <= settings.range_m) & (ahead >= np.hypot(dx, dy) * np.cos(np.radians(settings.half_width_deg)))
    _, mast = np.unique(np.round(np.stack([panels.x, panels.y], axis=1)), axis=0, return_inverse=True)
    # Both panels of a mast are equally far: the one that faces the vehicle more squarely comes first.
    order = np.lexsort((-ahead, np.round(distance, 3)), axis=1)
    in_view = np.take_along_axis(seen, order, axis=1)
    mast_of = mast.tolist()
    chosen = np.full((len(at), settings.sites), -1)
    for row in range(len(at)):
        nearest: dict[int, int] = {}
        for k in order[row, in_view[row]].tolist():
            nearest.setdefault(mast_of[k], k)
        best = list(nearest.values())[: settings.sites]
        chosen[row, : len(best)] = best
    return np.repeat(chosen, hold, axis=0)[: len(position)]
