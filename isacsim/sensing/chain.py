"""The chain from a vehicle's true motion and the sites around it to fixes of where the vehicle is.

Sites are assigned to the vehicle; every site's echo is drawn and estimated at every snapshot; and the estimates of a
snapshot are fused into a fix. A Kalman filter then turns fixes into states (`isacsim.sensing.following`). A key seeds
every draw, so a vehicle's fixes come out the same alone, with others, and in any order.
"""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from isac_cosim.base.arrays import Array, BoolArray, IntArray
from isac_cosim.base.seeding import stream
from isac_cosim.base.settings import Settings, WithOptionalParts
from isac_cosim.isacsim.heading import heading_rad
from isac_cosim.isacsim.panels import Panels
from isac_cosim.isacsim.radio.blockage import Blockers
from isac_cosim.isacsim.radio.channel import ChannelSettings, EchoGeometry, snr_db
from isac_cosim.isacsim.radio.estimators import ESTIMATORS
from isac_cosim.isacsim.radio.waveform import Waveform
from isac_cosim.isacsim.scene.settings import SceneSettings
from isac_cosim.isacsim.sensing.following import Approach, Observed, filled
from isac_cosim.isacsim.tracking.fusion import Fixes
from isac_cosim.isacsim.tracking.fusion_methods import FUSION_METHODS, FusionSettings
from isac_cosim.isacsim.tracking.kalman import TrackingSettings

LEAST_SITES = 2
"""Fewest sites that locate a vehicle."""
CONFIRMED = 0.25
"""Share of the snapshots before a record that must have located the vehicle: one or two false alarms are no vehicle."""


class ViewSettings(Settings):
    """Which sites sense a vehicle."""

    sites: int = Field(4, ge=1, le=8, description="Most sites used at once.")
    range_m: float = Field(
        350.0, gt=0, le=1e5, description="Farthest vehicle that a site senses; at most what the cyclic prefix carries."
    )
    half_width_deg: float = Field(60.0, gt=0, lt=90, description="A panel sees this far to either side of its azimuth.")
    speed_mps: float = Field(100.0, gt=0, le=1e3, description="Highest radial speed accepted as a vehicle's.")
    hold_s: float = Field(0.1, gt=0, le=1e5, description="Time after which the sites of a vehicle are chosen anew.")


def _current_name(value: Any) -> Any:
    """The present name of a way to draw echoes; files written before call the DFT block "window"."""
    return "block" if value == "window" else value


class SensingSettings(WithOptionalParts):
    """The sensing chain of a study. The defaults are the paper's where it gives any."""

    optional_parts: ClassVar[frozenset[str]] = frozenset({"scene"})

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
    target_height_m: float = Field(
        0.8, ge=0, le=20, description="Height of the vehicle's reflecting point above the road."
    )
    fusion: FusionSettings = Field(default_factory=FusionSettings)
    tracking: TrackingSettings = Field(default_factory=TrackingSettings)
    scene: SceneSettings | None = Field(
        None,
        description="The sites sense all vehicles at once and have to find out who is who; absent: one vehicle alone, "
        "whose identity is known. With it, `waveform`, `estimator`, `echo`, `fusion` and `view.sites` have no effect.",
    )

    @model_validator(mode="before")
    @classmethod
    def _link_budget_of_a_scene(cls, content: Any) -> Any:
        """A scene has the link budget, where no channel is given."""
        if isinstance(content, dict) and content.get("scene") is not None and "channel" not in content:
            return {**content, "channel": {"kind": "link"}}
        return content

    @model_validator(mode="after")
    def _of_a_scene(self) -> Self:
        if self.scene is not None and self.channel.kind != "link":
            raise ValueError(f'channel.kind "{self.channel.kind}": a scene has the link budget; make it "link"')
        if self.scene is not None and self.channel.blockage:
            raise ValueError("channel.blockage: scenes have no blockage but `scene.blockage`; turn it off")
        return self

    @model_validator(mode="after")
    def _within_the_cyclic_prefix(self) -> Self:
        longest_m = self.waveform.longest_range_m
        if self.view.range_m > longest_m:
            raise ValueError(
                f"view.range_m {self.view.range_m:g} is beyond the {longest_m:.0f} m that waveform.cyclic_prefix_s "
                f"carries: lower it to {int(longest_m)}, or lengthen the prefix"
            )
        return self


def fix(
    approach: Approach,
    rate_hz: float,
    sites: Panels,
    settings: SensingSettings,
    key: tuple[str | int, ...],
    blockers: Blockers | None = None,
) -> Observed:
    """Draw the echoes of one passage, estimate from them, and fuse the estimates.

    approach: the true motion, run-in included, S snapshots at rate_hz. sites: all panels. key: seeds the draws.
    blockers: the other vehicles, needed if the channel has blockage. Returns the fixes of all S snapshots.
    Raises InputError if blockage is on without other vehicles.
    """
    motion = approach.motion
    slots = assign(motion[:2].T, rate_hz, sites, settings.view)
    assigned = slots >= 0
    n_sites = int(assigned.sum(axis=1).min())
    if n_sites < LEAST_SITES:
        return _unseen(motion.shape[1], n_sites)
    heading, time_s = _heading_rad(motion, approach.carried), approach.time_s(rate_hz)
    number, panels = serving(slots, sites)
    geometry = EchoGeometry(motion[:2].T, heading, number, panels, time_s)
    level = snr_db(settings.channel, settings.waveform, geometry, blockers, key)
    fixes, used = fused(motion[:4].T, slots, panels, level, settings, key)
    fixes = filled(fixes)
    if fixes.valid[: approach.run_in + 1].mean() < CONFIRMED:
        return _unseen(motion.shape[1], 0)
    return Observed(fixes, n_sites, float(level[assigned].mean()), float(used.sum() / assigned.sum()), True)


def fused(
    states: Array,
    slots: IntArray,
    panels: Panels,
    level_db: Array,
    settings: SensingSettings,
    key: tuple[str | int, ...],
) -> tuple[Fixes, BoolArray]:
    """Draw the echoes of S snapshots at I panels, estimate from them, and fuse the estimates that are used.

    states: true x, y, vx, vy, (S, 4). slots, level_db: the number of each echo's site, -1 without one, and its SNR, dB,
    (S, I). panels: of the echoes, as `serving` gives them, (S, I). key: seeds the draws. Returns the fixes, and which
    echoes they rest on, (S, I).
    """
    measured, deviation, power = _measure(panels.measured(states), level_db, settings, key)
    threshold = np.log(8 * settings.waveform.size / settings.false_alarm)
    used = (slots >= 0) & (power > threshold) & plausible(measured, settings.view)
    return FUSION_METHODS[settings.fusion.method](measured, deviation, used, panels, settings.fusion), used


def serving(slots: IntArray, sites: Panels) -> tuple[IntArray, Panels]:
    """Return the sites of slots, (S, I), and their panels. An empty slot repeats the first; it is not used."""
    number = np.where(slots >= 0, slots, slots[:, :1])
    return number, sites.take(number)


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
    return Observed(fixes, n_sites, 0.0, 0.0, False)


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
    unseen = len(panels.x)
    rank = np.empty_like(order)
    np.put_along_axis(rank, order, np.arange(unseen)[None], axis=1)
    by_mast = np.argsort(mast, kind="stable")
    first_of_mast = np.flatnonzero(np.diff(mast[by_mast], prepend=-1))
    ranks_of_masts = np.minimum.reduceat(np.where(seen, rank, unseen)[:, by_mast], first_of_mast, axis=1)
    best = np.sort(ranks_of_masts, axis=1)[:, : settings.sites]
    chosen = np.full((len(at), settings.sites), -1)
    nearest = np.take_along_axis(order, np.minimum(best, unseen - 1), axis=1)
    chosen[:, : best.shape[1]] = np.where(best < unseen, nearest, -1)
    return np.repeat(chosen, hold, axis=0)[: len(position)]
