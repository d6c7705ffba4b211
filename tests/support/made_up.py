"""Records of the seven intentions made from formulas, so that the predictors are tested without traffic."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd

from isac_cosim.base.seeding import stream
from isac_cosim.labeling.intentions import Intention
from isac_cosim.models.data.fit_settings import OptimiserSettings
from isac_cosim.models.data.pre_onset import PreOnsetSettings
from isac_cosim.models.data.states import StatesOnDisk
from isac_cosim.models.data.windows import Records, WindowSettings
from isac_cosim.models.predictors.asi_bip import AsiBipSettings
from isac_cosim.models.predictors.trees import TreesSettings
from isac_cosim.models.runs.settings import TrainSettings

TV_RATE_HZ, UV_RATE_HZ = 400.0, 100.0
BEFORE_ONSET_S, DURATION_S = 2.6, 5.0


def _motion(intention: Intention, t: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Accelerations (2, n) along and across the lane, m/s2, at t seconds after onset."""
    along = rng.normal(0, 0.3) * np.cos(0.5 * t + rng.uniform(0, 6))
    across = np.zeros_like(t)
    ramp = np.clip(t / rng.uniform(0.3, 0.8), 0, 1)
    if intention is Intention.HARD_BRAKE:
        along = along - rng.uniform(4, 7) * ramp
    elif intention is Intention.HARD_ACCEL:
        along = along + rng.uniform(2.5, 4) * ramp
    elif intention is Intention.EVASIVE_SWERVE:
        across = rng.choice([-1, 1]) * rng.uniform(3, 5) * np.sin(2 * np.pi * t / rng.uniform(1.6, 2.2)) * (t > 0)
    elif intention is not Intention.FOLLOWING:
        sign = -1 if intention is Intention.RIGHT_LANE_CHANGE else 1
        length = rng.uniform(3.5, 5)
        across = sign * 3.2 * (2 * np.pi / length**2) * np.sin(2 * np.pi * t / length) * ((t > 0) & (t < length))
        if intention is Intention.OVERTAKE:
            along = along + rng.uniform(0.6, 1.2) * ramp
    return np.stack([along + np.zeros_like(t), across])


def _states(acceleration: np.ndarray, speed: float, start: tuple[float, float], step: float) -> np.ndarray:
    """(6, n) from accelerations (2, n), by summation."""
    velocity = np.array([[speed], [0.0]]) + np.cumsum(acceleration, axis=1) * step
    position = np.array(start)[:, None] + np.cumsum(velocity, axis=1) * step
    return np.concatenate([position, velocity, acceleration])


def _turn(states: np.ndarray, angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return np.einsum("ij,pjt->pit", np.array([[c, -s], [s, c]]), states.reshape(3, 2, -1)).reshape(6, -1)


def make_records(seeds: int = 8, per_class: int = 4, noise: float = 1.0) -> Records:
    """`per_class` records of every intention in each of `seeds` scenario seeds."""
    t_tv = np.arange(int(DURATION_S * TV_RATE_HZ)) / TV_RATE_HZ - BEFORE_ONSET_S
    t_uv = np.arange(int(DURATION_S * UV_RATE_HZ)) / UV_RATE_HZ - BEFORE_ONSET_S
    tv, uv, rows = [], [], []
    for seed in range(seeds):
        angle = stream("road", seed).uniform(-3, 3)
        for k in range(per_class * len(Intention)):
            rng = stream("synthetic", seed, k)
            intention = Intention(k % len(Intention))
            speed = rng.uniform(18, 34)
            gap = rng.uniform(15, 60)
            slow = rng.uniform(3, 8) if intention in (Intention.OVERTAKE, Intention.HARD_BRAKE) else rng.uniform(-3, 3)
            state = _states(_motion(intention, t_tv, rng), speed, (0.0, 0.0), 1 / TV_RATE_HZ)
            walk = (
                np.cumsum(rng.normal(0, 0.02, state.shape), axis=1) * np.array([0.1, 0.1, 0.1, 0.1, 0.3, 0.3])[:, None]
            )
            state = state + noise * (
                walk + rng.normal(0, 1, state.shape) * np.array([[0.05] * 2 + [0.05] * 2 + [0.2] * 2]).T
            )
            other = _states(0.1 * rng.normal(size=(2, 1)) * np.sin(t_uv), speed - slow, (gap, 0.0), 1 / UV_RATE_HZ)
            place = np.array([rng.uniform(0, 3000), rng.uniform(-500, 500), 0, 0, 0, 0])[:, None]
            tv.append(_turn(state, angle) + place)
            uv.append(_turn(other, angle) + place)
            start = rng.uniform(100, 400)
            onset = start + BEFORE_ONSET_S
            rows.append(
                (
                    f"toy-{seed}-{k}",
                    "toy",
                    seed,
                    int(intention),
                    start,
                    onset,
                    onset + rng.uniform(0.3, 2.0),
                    rng.uniform(0, 10),
                )
            )
    columns = ["sample_id", "scenario", "seed", "label", "t_start", "t_onset", "t_commit", "snr_db"]
    table = pd.DataFrame(rows, columns=columns)
    table["origin"] = np.resize(["natural", "commanded", "commanded"], len(table))
    table["n_sites"] = 4
    return Records(np.array(tv, np.float32), np.array(uv, np.float32), TV_RATE_HZ, UV_RATE_HZ, table)


MADE_OF = {"digest": "made up", "study": {"scenarios": ["made up"]}}
SMALL_RUN = TrainSettings(
    windows=WindowSettings(window_s=1.2),
    asi_bip=AsiBipSettings(hidden=12, width=16, heads=4, feedforward=32, dropout=0.05),
    optimiser=OptimiserSettings(epochs=3, batch=16, learning_rate=5e-3, schedule="cosine", threads=1),
    trees=TreesSettings(rounds=10, ends_per_record=1),
    pre_onset=PreOnsetSettings(rounds=20, ends_per_record=1),
)


def on_disk(records: Records) -> Records:
    """The same records with their states on disk."""
    states = {"tv": records.tv, "uv": records.uv}
    lengths = {name: values.shape[2] for name, values in states.items()}
    return replace(records, **StatesOnDisk.copied([states], len(records), lengths))
