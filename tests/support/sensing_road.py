"""A straight road with masts on alternating sides, and motions on it: synthetic truth for the sensing tests."""

import numpy as np

from isac_cosim.isacsim.scenarios.scenario import Site

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
