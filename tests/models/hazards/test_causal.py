"""The causal network: one step after the other, whole sequences and windows give the same answers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from torch.nn import functional

from isac_cosim.base.arrays import Array
from isac_cosim.models.data.lane_map import LaneMap
from isac_cosim.models.data.windows import OnMap, Windows, WindowSettings, in_frame
from isac_cosim.models.hazards.answers import IGNORED, WITH_HAZARD
from isac_cosim.models.hazards.blocks import FEATURES, steps_of
from isac_cosim.models.hazards.causal import CausalPredictor
from isac_cosim.models.hazards.hazard_training import hazard_loss
from isac_cosim.models.networks.causal import CausalNetwork, layers_within, receptive_field
from tests.models.hazards.test_predictor import SHAPE, facts
from tests.support.scripted import LANES


def network(outputs: int = 11) -> CausalNetwork:
    torch.manual_seed(1)
    return CausalNetwork(len(FEATURES), 16, layers_within(22), outputs, 0.3).eval()


def test_a_window_of_2_2_s_is_looked_at_whole() -> None:
    assert receptive_field(layers_within(22)) == 22


def test_step_by_step_gives_what_the_whole_sequence_gives() -> None:
    of_steps, model = torch.randn(3, 60, len(FEATURES)), network()
    whole = model(of_steps)
    state, stepped = model.begin(3), []
    for step in of_steps.unbind(dim=1):
        logits, state = model.step(step, state)
        stepped.append(logits)
    assert torch.allclose(torch.stack(stepped, dim=1), whole, atol=1e-5)


def test_an_answer_depends_on_no_later_step_and_on_none_before_the_receptive_field() -> None:
    of_steps, model = torch.randn(1, 60, len(FEATURES)), network()
    changed = of_steps.clone()
    changed[:, 31:] += 1.0
    changed[:, :9] += 1.0
    before, after = model(of_steps)[0], model(changed)[0]
    assert torch.allclose(before[30], after[30], atol=1e-5)
    assert not torch.allclose(before[29], after[29], atol=1e-5)
    assert not torch.allclose(before[31], after[31], atol=1e-5)


def driving(seconds: float) -> tuple[Array, Array]:
    """A TV that weaves along a road of two lanes, and its leader: (6, T) and (6, U)."""
    parts = []
    for rate_hz, ahead in ((400.0, 0.0), (100.0, 30.0)):
        t = np.arange(1, round(seconds * rate_hz) + 1) / rate_hz
        across, speed = np.sin(t + ahead), 20.0 + np.cos(0.5 * t + ahead)
        parts.append(
            np.stack([
                400 + ahead + 20 * t + 2 * np.sin(0.5 * t + ahead), 1.6 + across,
                speed, np.cos(t + ahead), -0.5 * np.sin(0.5 * t + ahead), -np.sin(t + ahead),
            ])
        )  # fmt: skip
    return parts[0], parts[1]


def windows_at(ends_s: list[float], seconds: float = 2.2) -> Windows:
    tv, uv = driving(12.0)
    cut = [
        (tv[:, : round(e * 400)][:, -round(seconds * 400) :], uv[:, : round(e * 100)][:, -round(seconds * 100) :])
        for e in ends_s
    ]
    both = [np.stack(part) for part in zip(*cut, strict=True)]
    on_map = OnMap.in_one(both[0], both[1], 400.0, LaneMap.of(LANES))
    return replace(in_frame(both[0], both[1], WindowSettings(), 400.0, 100.0), on_map=on_map)


@pytest.mark.parametrize("uv", [True, False])
@pytest.mark.parametrize("lanes", [True, False])
def test_carried_along_the_stream_it_answers_as_on_windows(uv: bool, lanes: bool) -> None:
    """The same driving in windows, one after the other, and one step a decision from the first window on."""
    predictor = CausalPredictor(facts(lanes=lanes, uv=uv), SHAPE, network())
    ends_s = np.round(np.arange(3.0, 9.0, 0.1), 9).tolist()
    on_windows = predictor(windows_at(ends_s)).logits
    outputs, state = predictor.begin(windows_at(ends_s[:1]))
    carried = [outputs.logits[0]]
    for end_s in ends_s[1:]:
        outputs, state = predictor.step(windows_at([end_s], seconds=0.1), state)
        carried.append(outputs.logits[0])
    assert np.ptp(on_windows, axis=0).max() > 0.01
    assert np.stack(carried) == pytest.approx(on_windows, abs=1e-4)


def test_without_lanes_it_answers_windows_whose_place_is_unknown() -> None:
    predictor = CausalPredictor(facts(lanes=False), SHAPE, network())
    windows = windows_at([5.0, 6.0])
    assert predictor(replace(windows, on_map=None)).logits == pytest.approx(predictor(windows).logits, abs=1e-3)


def test_steps_tell_how_the_tv_moves_in_its_lane() -> None:
    on_map = windows_at([6.0]).on_map
    assert on_map is not None
    values = dict(zip(FEATURES, steps_of(on_map, (40, 10), True)[0, -1].tolist(), strict=True))
    t, u = 5.95, 5.95 + 30.0
    assert values["along"] == pytest.approx(20 + np.cos(0.5 * t), abs=0.02)
    assert values["across"] == pytest.approx(np.cos(t), abs=0.02)
    assert values["across_acceleration"] == pytest.approx(-np.sin(t), abs=0.02)
    assert values["across_slope"] == pytest.approx(-np.sin(t), abs=0.05)
    assert values["offset"] == pytest.approx(np.sin(t), abs=0.02)
    assert values["to_left"] + values["to_right"] == pytest.approx(3.2, abs=1e-5)
    assert values["left_lane"] == pytest.approx(0.0, abs=0.05)
    assert values["right_lane"] > 3.0
    gap = 30 + 2 * np.sin(0.5 * u - 15 + 30) - 2 * np.sin(0.5 * t)
    assert values["gap"] == pytest.approx(gap, abs=0.2)
    assert values["uv_aside"] == pytest.approx(np.sin(u) - np.sin(t), abs=0.05)
    assert values["closing"] == pytest.approx(values["along"] - values["uv_along"], abs=1e-4)


def test_the_loss_asks_each_hazard_until_the_intention_has_begun() -> None:
    """Against a sum over hazards, one at a time."""
    rng = np.random.default_rng(1)
    logits = rng.normal(size=(4, 7, 16))
    interval = rng.integers(-1, 4, size=(4, 7, 5))
    passing = rng.integers(-1, 2, size=(4, 7))
    learned = np.array([True, True, False, True, True])
    total = 0.0
    for i, j in np.ndindex(4, 7):
        for c in range(len(WITH_HAZARD)):
            for h in range(3):
                if learned[c] and interval[i, j, c] != IGNORED and interval[i, j, c] >= h:
                    z = torch.tensor(logits[i, j, 3 * c + h])
                    total += float(functional.softplus(-z if interval[i, j, c] == h else z))
        if passing[i, j] != IGNORED:
            z = torch.tensor(logits[i, j, -1])
            total += float(functional.softplus(-z if passing[i, j] else z))
    decisions = (interval != IGNORED).any(axis=2).sum()
    weight = np.full((4, 7), 2.0)
    loss = hazard_loss(*map(torch.tensor, (logits, interval, passing, weight, learned)), 3)
    assert float(loss) == pytest.approx(total / decisions, rel=1e-6)
    weight[0] = 0.0
    parts = [torch.tensor(values) for values in (logits, interval, passing, weight)]
    without = [part[1:] for part in parts]
    of_some = [float(hazard_loss(*some, torch.tensor(learned), 3)) for some in (parts, without)]
    assert of_some[0] == pytest.approx(of_some[1], rel=1e-9)
