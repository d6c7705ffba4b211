"""A straight road with masts on alternating sides, and motions on it: synthetic truth for the sensing tests."""

from collections.abc import Sequence

import numpy as np

from isac_cosim.isacsim.scenarios.scenario import Site
from isac_cosim.isacsim.sensing.chain import SensingSettings
from isac_cosim.isacsim.sensing.onboard_radar import RadarSettings
from isac_cosim.isacsim.sensing.passages import Carrier, Passage, SensedRecord, WatchedTraffic
from isac_cosim.isacsim.sensing.sensors import watch
from isac_cosim.isacsim.sensing.sensors.protocol import SensorSettings

RATE_HZ = 400.0


def road_sites(masts: int = 16, spacing_m: float = 150.0) -> list[Site]:
    """Masts along +x from -600 m, 20 m aside, 10 or 25 m high, each with two panels toward the road."""
    return [
        Site(f"m{mast}-{azimuth}", -600 + spacing_m * mast, (-20.0, 20.0)[side], 25.0 if mast % 3 else 10.0, azimuth)
        for mast in range(masts)
        for side in [(mast + 1) % 2]
        for azimuth in ((45.0, 315.0), (135.0, 225.0))[side]
    ]


def integrated(values: np.ndarray, start: float) -> np.ndarray:
    """Integral of values over time from `start` on, by the trapezium rule."""
    return start + np.concatenate([[0.0], np.cumsum((values[1:] + values[:-1]) / 2)]) / RATE_HZ


def drive(
    snapshots: int, x: float, y: float, speed: float, along: np.ndarray | float = 0.0, aside: np.ndarray | float = 0.0
) -> np.ndarray:
    """Truth (6, S) of a vehicle driving along +x with the given accelerations, m/s2."""
    ax, ay = (np.broadcast_to(np.asarray(a, dtype=np.float64), (snapshots,)) for a in (along, aside))
    vx, vy = integrated(ax, speed), integrated(ay, 0.0)
    return np.stack([integrated(vx, x), integrated(vy, y), vx, vy, ax, ay])


def time(snapshots: int) -> np.ndarray:
    return np.arange(snapshots) / RATE_HZ


def hard_brake(snapshots: int, x: float = 100.0) -> np.ndarray:
    """-8 m/s2 reached within 0.3 s, held, let go."""
    t = time(snapshots)
    return drive(snapshots, x, 1.6, 30.0, along=-8 * np.clip((t - 1) / 0.3, 0, 1) * np.clip((3.3 - t) / 0.3, 0, 1))


def swerve(snapshots: int, x: float = 100.0) -> np.ndarray:
    """6 m/s2 to one side and the other within 1 s."""
    t = time(snapshots)
    return drive(snapshots, x, -1.6, 25.0, aside=np.where((t > 1) & (t < 2), 6 * np.sin(2 * np.pi * (t - 1)), 0.0))


def sense(
    truth: np.ndarray,
    sites: Sequence[Site],
    settings: SensingSettings,
    keys: Sequence[tuple[str | int, ...]],
    past: np.ndarray | None = None,
) -> list[SensedRecord]:
    """What the sites know of records, truth (B, 6, S) and past (B, 6, P)."""
    pasts = [None] * len(keys) if past is None else list(past)
    passages = [Passage("tv", 0.0, *of) for of in zip(truth, keys, pasts, strict=True)]
    return watch("isac", WatchedTraffic("road", 1, sites, RATE_HZ), SensorSettings(sensing=settings)).record(passages)


def sense_onboard(
    truth: np.ndarray, carriers: Sequence[Carrier], settings: RadarSettings, keys: Sequence[tuple[str | int, ...]]
) -> list[SensedRecord]:
    """What the radars of the UVs know of records, truth (B, 6, S)."""
    passages = [
        Passage("tv", 0.0, motion, key, find_carrier=lambda carrier=carrier: carrier)
        for motion, carrier, key in zip(truth, carriers, keys, strict=True)
    ]
    return watch("radar", WatchedTraffic("road", 1, [], RATE_HZ), SensorSettings(radar=settings)).record(passages)
