"""What is shown of CaSTFormer's modules is what they compute: their outputs follow from it."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from isac_cosim.models.networks.castformer_inspection import inspected
from isac_cosim.models.networks.castformer_modules import shifted
from isac_cosim.models.predictors.castformer import CastformerCore, CastformerSettings

N, T, WIDTH, CLASSES = 5, 9, 16, 6


def core(**settings: object) -> CastformerCore:
    torch.manual_seed(3)
    chosen = CastformerSettings.model_validate({"width": WIDTH, "heads": 1, "encoder_layers": 1, **settings})
    return CastformerCore(chosen, CLASSES, 7, 5, speed=True).eval()


def streams() -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    rng = torch.Generator().manual_seed(4)
    return tuple(torch.randn(N, T, width, generator=rng) for width in (7, 5, 1))  # type: ignore[return-value]


@pytest.mark.parametrize("delay", [0, 1, 3])
@pytest.mark.parametrize("attention", ["bda", "self", "one_way"])
def test_the_output_of_rsf_follows_from_the_shown_attention(attention: str, delay: int) -> None:
    network, given = core(attention=attention, delay_frames=delay), streams()
    shown = inspected(network, lambda: network(*given)).attention
    assert shown is not None
    assert shown.shape == (N, 2, T)
    np.testing.assert_allclose(shown.sum(axis=2), 1, atol=1e-6)
    assert not shown[:, :, :delay].any(), "no frame younger than the delay is attended to"
    rsf = network.stages[0]
    encoded = network.inner(given[0]), network.outer(given[1])
    for k in range(2):
        other = encoded[k if attention == "self" or (attention == "one_way" and k == 1) else 1 - k]
        attend = rsf.attend[k]
        weights, bias = attend.attention.in_proj_weight[2 * WIDTH :], attend.attention.in_proj_bias[2 * WIDTH :]
        values = (other @ weights.T + bias).flip(dims=(1,)).detach().numpy()
        mixed = torch.from_numpy(np.einsum("nt,ntd->nd", shown[:, k], values)).float()
        expected = attend.attention.out_proj(mixed).detach().numpy()
        output = attend(encoded[k][:, -1:], other)[:, 0].detach().numpy()
        np.testing.assert_allclose(expected, output, atol=1e-5)
    assert shifted(encoded[0], delay).shape == encoded[0].shape


def test_gates_and_residuals_are_what_cpe_adds() -> None:
    network, given = core(rsf=False, fsn=False), streams()
    shown = inspected(network, lambda: network(*given))
    assert shown.gate is not None
    assert shown.residual is not None
    assert (shown.attention, shown.weight) == (None, None)
    cpe = network.stages[0]
    encoded = network.inner(given[0]), network.outer(given[1])
    for k, part in enumerate((cpe.inner, cpe.outer)):
        stream, other = encoded[k], encoded[1 - k]
        added = (part(stream, other) - stream)[:, -1]
        ratio = added.norm(dim=-1) / stream[:, -1].norm(dim=-1)
        np.testing.assert_allclose(shown.residual[:, k], ratio.detach().numpy(), rtol=1e-4)
        whole = part.residual(stream, other)[:, -1].norm(dim=-1)
        np.testing.assert_allclose(shown.gate[:, k], (added.norm(dim=-1) / whole).detach().numpy(), rtol=1e-3)


def test_the_logits_follow_from_the_shown_weights() -> None:
    network, given = core(), streams()
    shown = inspected(network, lambda: network(*given)).weight
    assert shown is not None
    by_name = network.training_logits(*given)
    branches = np.stack([by_name[name].detach().numpy() for name in ("in", "out", "context")], axis=1)
    np.testing.assert_allclose((shown[:, :, None] * branches).sum(axis=1), by_name["joint"].detach().numpy(), atol=1e-5)


def test_looking_changes_nothing() -> None:
    network, given = core(order="cpe-fsn-rsf"), streams()
    before = network(*given)
    assert inspected(network, lambda: network(*given)).attention is not None
    assert torch.equal(network(*given), before)
    assert not any(module._forward_hooks for module in network.modules())
