"""LSTMs side by side give what torch's own give, to the last bit, and leave the number of threads alone."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor, nn

from isac_cosim.base.workers.threads import torch_threads
from isac_cosim.models.networks import lstms
from isac_cosim.models.networks.lstms import outputs


@pytest.fixture(autouse=True)
def threads() -> Iterator[int]:
    with torch_threads(2):
        yield 2


def branches(features: int = 6, hidden: int = 8, **settings: bool) -> list[nn.LSTM]:
    torch.manual_seed(0)
    return [nn.LSTM(features, hidden, bidirectional=True, **settings) for _ in range(2)]


def streams(features: int = 6, batch: int = 3, steps: tuple[int, int] = (40, 10)) -> list[Tensor]:
    """Return inputs of which time is the last axis in memory, as in windows."""
    return [torch.randn(batch, features, count).permute(2, 0, 1) for count in steps]


def gradients(cells: list[nn.LSTM], results: list[Tensor]) -> list[Tensor]:
    for cell in cells:
        cell.zero_grad()
    torch.stack([result.square().mean() for result in results]).sum().backward()
    return [parameter.grad.clone() for cell in cells for parameter in cell.parameters() if parameter.grad is not None]


def count_directions(monkeypatch: pytest.MonkeyPatch) -> list[bool]:
    """Return a list that gets an entry for each direction that runs on a thread of its own."""
    directions: list[bool] = []
    plain = lstms._direction

    def counted(*tensors: Tensor, dtype: torch.dtype, reverse: bool, train: bool) -> Tensor:
        directions.append(reverse)
        return plain(*tensors, dtype=dtype, reverse=reverse, train=train)  # type: ignore[arg-type]

    monkeypatch.setattr(lstms, "_direction", counted)
    return directions


@settings(max_examples=25, deadline=None)
@given(features=st.integers(1, 9), hidden=st.integers(1, 70), batch=st.integers(1, 40), steps=st.integers(1, 60))
def test_outputs_and_gradients_are_those_of_torch(features: int, hidden: int, batch: int, steps: int) -> None:
    cells, inputs = branches(features, hidden), streams(features, batch, (steps, 7))
    results = outputs(cells, inputs)
    results += gradients(cells, results)
    with torch_threads(1):
        expected = [cell(x)[0] for cell, x in zip(cells, inputs, strict=True)]
        expected += gradients(cells, expected)
    assert all(torch.equal(result, value) for result, value in zip(results, expected, strict=True))


def test_every_direction_runs_on_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    directions = count_directions(monkeypatch)
    outputs(branches(), streams())
    assert sorted(directions) == [False, False, True, True]


def test_gradients_reach_the_inputs() -> None:
    cells, inputs = branches(), [x.requires_grad_() for x in streams()]
    outputs(cells, inputs)[0].sum().backward()
    (expected,) = torch.autograd.grad(cells[0](inputs[0])[0].sum(), inputs[:1])
    assert inputs[0].grad is not None
    assert torch.equal(inputs[0].grad, expected)


@pytest.mark.parametrize("context", [torch.no_grad, torch.inference_mode])
def test_predictions_need_no_gradients(context: type[torch.no_grad], monkeypatch: pytest.MonkeyPatch) -> None:
    directions = count_directions(monkeypatch)
    cells, inputs = [cell.eval() for cell in branches()], streams()
    with context():
        results = outputs(cells, inputs)
        assert [torch.equal(result, cell(x)[0]) for result, cell, x in zip(results, cells, inputs, strict=True)]
    assert len(directions) == 4
    assert not any(result.requires_grad for result in results)


@pytest.mark.parametrize(
    "cells",
    [branches(batch_first=True), branches(bias=False), [nn.LSTM(6, 8, 2, bidirectional=True)] * 2],
    ids=["batch first", "no bias", "two layers"],
)
def test_other_lstms_are_called_as_they_are(cells: list[nn.LSTM], monkeypatch: pytest.MonkeyPatch) -> None:
    directions, inputs = count_directions(monkeypatch), streams()
    for result, cell, x in zip(outputs(cells, inputs), cells, inputs, strict=True):
        assert torch.equal(result, cell(x)[0])
    assert not directions


@pytest.mark.skipif(not lstms.has_bfloat16(), reason="the processor does not compute in bfloat16")
def test_in_bfloat16_they_are_those_of_torch(monkeypatch: pytest.MonkeyPatch) -> None:
    directions = count_directions(monkeypatch)
    cells, inputs = branches(), streams()
    with torch.autocast("cpu", torch.bfloat16):
        results = outputs(cells, inputs)
        with torch_threads(1):
            expected = [cell(x)[0] for cell, x in zip(cells, inputs, strict=True)]
    assert len(directions) == 4
    assert {result.dtype for result in results} == {torch.bfloat16}
    results += gradients(cells, [result.float() for result in results])
    expected += gradients(cells, [result.float() for result in expected])
    assert all(torch.equal(result, value) for result, value in zip(results, expected, strict=True))


@pytest.mark.skipif(not lstms.has_bfloat16(), reason="elsewhere, PyTorch may refuse an LSTM in bfloat16")
def test_without_bfloat16_torch_s_own_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lstms, "has_bfloat16", lambda: False)
    directions = count_directions(monkeypatch)
    with torch.autocast("cpu", torch.bfloat16):
        outputs(branches(), streams())
    assert not directions


def test_the_number_of_threads_stays(threads: int) -> None:
    cells, inputs = branches(), streams()
    gradients(cells, outputs(cells, inputs))
    assert torch.get_num_threads() == threads
    assert set(lstms._pool(threads).map(lambda _: torch.get_num_threads(), range(8))) == {1}


def test_one_thread_calls_torch_s_own(monkeypatch: pytest.MonkeyPatch) -> None:
    directions = count_directions(monkeypatch)
    with torch_threads(1):
        outputs(branches(), streams())
    assert not directions
