"""Bidirectional LSTMs side by side: every direction on a thread of its own.

One step of an LSTM over a batch is so short that threads which share it spend their time waiting for each other. The
directions do not depend on each other, so each runs on one thread, forward and backward. The results are those of
`torch.nn.LSTM` on one thread, to the last bit.
"""

# mypy: disable-error-code="no-untyped-call"
# torch is typed in part only.
from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache, partial
from typing import Any

import torch
from threadpoolctl import threadpool_limits
from torch import Tensor, nn
from torch.autograd.function import once_differentiable

LSTM_MODE = 2
"""The LSTM's number among the recurrent layers of `torch.mkldnn_rnn_layer`."""
WEIGHTS = ("weight_ih_l0", "weight_hh_l0", "bias_ih_l0", "bias_hh_l0")
SUFFIXES = ("", "_reverse")


def outputs(lstms: Sequence[nn.LSTM], inputs: Sequence[Tensor]) -> list[Tensor]:
    """Return the outputs of bidirectional LSTMs, (T, B, 2 hidden) each, of inputs (T, B, features).

    Under autocast to bfloat16, the outputs are in bfloat16. With one thread, on a GPU, in other precisions or while the
    network is traced, this is a call of each LSTM.
    """
    threads, dtype = torch.get_num_threads(), _precision()
    if threads == 1 or not all(_separable(lstm, x) for lstm, x in zip(lstms, inputs, strict=True)):
        return [lstm(x)[0] for lstm, x in zip(lstms, inputs, strict=True)]
    parts = [
        (x, *(getattr(lstm, name + suffix) for name in WEIGHTS))
        for lstm, x in zip(lstms, inputs, strict=True)
        for suffix in SUFFIXES
    ]
    train = torch.is_grad_enabled()
    directions = [
        partial(_direction, dtype=dtype, reverse=bool(k % 2), train=lstms[k // 2].training) for k in range(len(parts))
    ]
    if train:
        halves = _SideBySide.apply(_pool(threads), directions, *(tensor for part in parts for tensor in part))
    else:
        halves = list(_pool(threads).map(_without_gradients, directions, parts))
    return [torch.cat((halves[k], halves[k + 1]), dim=2) for k in range(0, len(halves), 2)]


def _separable(lstm: nn.LSTM, x: Tensor) -> bool:
    """Return whether PyTorch computes the LSTM by one call of oneDNN for each direction, as `_direction` does."""
    return (
        (lstm.num_layers, lstm.bidirectional, lstm.batch_first, lstm.bias, lstm.proj_size) == (1, True, False, True, 0)
        and (x.device.type, x.dtype, lstm.weight_ih_l0.dtype) == ("cpu", torch.float32, torch.float32)
        and lstm.training >= torch.is_grad_enabled()
        and x.numel() > 0
        and torch.backends.mkldnn.is_available()
        and (_precision() == torch.float32 or (_precision() == torch.bfloat16 and has_bfloat16()))
        and not torch.compiler.is_compiling()
    )


def has_bfloat16() -> bool:
    """Return whether oneDNN computes in bfloat16 on this processor."""
    return bool(torch.ops.mkldnn._is_mkldnn_bf16_supported())


def _precision() -> torch.dtype:
    """Return the precision in which an LSTM computes here."""
    return torch.get_autocast_dtype("cpu") if torch.is_autocast_enabled("cpu") else torch.float32


def _direction(
    x: Tensor,
    weight_ih: Tensor,
    weight_hh: Tensor,
    bias_ih: Tensor,
    bias_hh: Tensor,
    *,
    dtype: torch.dtype,
    reverse: bool,
    train: bool,
) -> Tensor:
    """Return one direction's output, (T, B, hidden), computed in a precision."""
    hidden = weight_hh.shape[1]
    x, zero = x.to(dtype).contiguous(), x.new_zeros(x.shape[1], hidden, dtype=dtype)
    weight_ih, weight_hh, bias_ih, bias_hh = (part.to(dtype) for part in (weight_ih, weight_hh, bias_ih, bias_hh))
    # Arguments as `torch.nn.LSTM` passes them: no batch sizes, one layer, biases, one direction, time first.
    sizes: list[int] = []
    layer = torch.mkldnn_rnn_layer(
        x, weight_ih, weight_hh, bias_ih, bias_hh, zero, zero,
        reverse, sizes, LSTM_MODE, hidden, 1, True, False, False, train,
    )  # fmt: skip
    return layer[0]


def _without_gradients(direction: partial[Tensor], part: tuple[Tensor, ...]) -> Tensor:
    with torch.no_grad():
        return direction(*part)


class _SideBySide(torch.autograd.Function):
    """Functions of five tensors each, run on threads, and so are their gradients."""

    @staticmethod
    def forward(
        ctx: Any, pool: ThreadPoolExecutor, directions: Sequence[partial[Tensor]], *tensors: Tensor
    ) -> tuple[Tensor, ...]:
        def run(direction: partial[Tensor], first: int) -> tuple[list[Tensor], Tensor]:
            part = tensors[first : first + size]
            with torch.enable_grad():
                leaves = [tensor.detach().requires_grad_(tensor.requires_grad) for tensor in part]
                return leaves, direction(*leaves)

        size = len(tensors) // len(directions)
        ctx.pool = pool
        ctx.graphs = list(pool.map(run, directions, range(0, len(tensors), size)))
        return tuple(output.detach() for _, output in ctx.graphs)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        def run(graph: tuple[list[Tensor], Tensor], gradient: Tensor) -> list[Tensor | None]:
            leaves, output = graph
            wanted = [leaf for leaf in leaves if leaf.requires_grad]
            computed = iter(torch.autograd.grad(output, wanted, gradient))
            return [next(computed) if leaf.requires_grad else None for leaf in leaves]

        parts = list(ctx.pool.map(run, ctx.graphs, gradients))
        return (None, None, *(gradient for part in parts for gradient in part))


@cache
def _pool(threads: int) -> ThreadPoolExecutor:
    """Return threads whose own calls into PyTorch use one thread each."""
    return ThreadPoolExecutor(threads, "lstm", initializer=_use_one_thread)


def _use_one_thread() -> None:
    # PyTorch sets a thread's number of OpenMP threads when the thread first asks; only after that may it be changed.
    torch.get_num_threads()
    threadpool_limits(1, user_api="openmp")
