"""What the modules of a trained CaSTFormer do with windows: attention, gates and residuals, and confidence weights.

Everything is of the last frame, which the answer is read from, and is recomputed from what the modules are given.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor, nn

from isac_cosim.base.arrays import Array
from isac_cosim.models.networks.castformer_modules import (
    CausalPatternExtraction,
    CausalResidual,
    Confidence,
    DelayedAttention,
    ReciprocalShiftFusion,
    delayed_mask,
    shifted,
)

STREAMS = ("in", "out")
BRANCHES = ("in", "out", "context")


@dataclass(frozen=True)
class Inspection:
    """What the modules do with n windows of T frames; None for modules that are off.

    attention: weights of RSF, mean over the heads, (n, 2, T), of the query of each stream by the age of the frame that
    is attended to, in frames before the window's last one; with the attention `joint`, both streams of keys together.
    gate: of CPE, (n, 2), Eq. (8). residual: length of the gated residual over that of the stream that it is added to,
    (n, 2). weight: of FSN's branches, (n, 3), w of Eq. (11); they sum to 1.
    """

    attention: Array | None
    gate: Array | None
    residual: Array | None
    weight: Array | None


def inspected(core: nn.Module, forward: Callable[[], object]) -> Inspection:
    """Return what the modules of a network do in a forward pass of the last frame; the network is in evaluation mode.

    core: the network, a `CastformerCore`. forward: runs it on the windows.
    """
    seen: dict[str, list[Tensor]] = {}
    handles: list[Any] = []

    def watch(module: nn.Module, name: str, read: Callable[[nn.Module, tuple[Tensor, ...]], Tensor]) -> None:
        def hook(called: nn.Module, given: tuple[Tensor, ...], _: object) -> None:
            seen.setdefault(name, []).append(read(called, given))

        handles.append(module.register_forward_hook(hook))

    for module in core.modules():
        if isinstance(module, ReciprocalShiftFusion):
            for attend in module.attend:
                watch(attend, "attention", _attention)
        elif isinstance(module, CausalPatternExtraction):
            for part in (module.inner, module.outer):
                watch(part, "gate", _gate)
                watch(part, "residual", _residual)
        elif isinstance(module, Confidence):
            watch(module, "weight", _weight)
    try:
        with torch.inference_mode():
            forward()
    finally:
        for handle in handles:
            handle.remove()
    by_stream = {name: torch.stack(parts, dim=1) for name, parts in seen.items() if name != "weight"}
    return Inspection(
        **{name: _array(by_stream[name]) if name in by_stream else None for name in ("attention", "gate", "residual")},
        weight=_array(seen["weight"][0]) if "weight" in seen else None,
    )


def _attention(module: nn.Module, given: tuple[Tensor, ...]) -> Tensor:
    """Return the weights of the last query by the age of the frame, (n, T); see `DelayedAttention.forward`."""
    assert isinstance(module, DelayedAttention)
    query, *streams = given
    length = streams[0].shape[1]
    mask = delayed_mask(length, module.frames, query.device)[-1:]
    keys = torch.cat([shifted(x, module.frames) for x in streams], dim=1)
    hidden = mask.repeat(1, len(streams))
    weights = module.attention(query[:, -1:], keys, keys, attn_mask=hidden, need_weights=True)[1]
    of_key = weights[:, 0].reshape(len(query), len(streams), length).sum(dim=1)
    # Key k is the frame k - `frames`, whose age is T - 1 - k + `frames`; the zeros in front have no frame.
    by_age = torch.zeros_like(of_key)
    visible = of_key[:, module.frames :].flip(dims=(1,))
    by_age[:, module.frames : module.frames + visible.shape[1]] = visible
    return by_age


def _gate(module: nn.Module, given: tuple[Tensor, ...]) -> Tensor:
    assert isinstance(module, CausalResidual)
    return torch.sigmoid(module.gate(module.residual(*given)))[:, -1, 0]


def _residual(module: nn.Module, given: tuple[Tensor, ...]) -> Tensor:
    assert isinstance(module, CausalResidual)
    residual, stream = module.residual(*given)[:, -1], given[0][:, -1]
    gated = torch.sigmoid(module.gate(residual)) * residual
    return torch.as_tensor(gated.norm(dim=-1) / stream.norm(dim=-1).clamp(min=1e-9))


def _weight(module: nn.Module, given: tuple[Tensor, ...]) -> Tensor:
    assert isinstance(module, Confidence)
    return module.branches(given[0])[1]


def _array(values: Tensor) -> Array:
    return values.double().cpu().numpy()
