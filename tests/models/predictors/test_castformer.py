"""CaSTFormer: no look ahead, no look aside, what each module computes, all combinations, one training."""

import itertools
from pathlib import Path
from typing import get_args

import pytest
import torch
from torch import Tensor, nn

from isac_cosim.base.errors import InputError
from isac_cosim.models.data.fit_settings import OptimiserSettings
from isac_cosim.models.data.windows import Records
from isac_cosim.models.networks.castformer_modules import (
    Attention,
    CausalResidual,
    ChannelGate,
    Confidence,
    DelayedAttention,
    MeanOver,
    delayed_mask,
    running_mean,
    shifted,
)
from isac_cosim.models.predictors.castformer import (
    PAPER_OPTIMISER,
    Castformer,
    CastformerCore,
    CastformerSettings,
    Order,
    castformer_loss,
    in_frames,
    positions,
)
from isac_cosim.models.predictors.protocol import WindowShape
from isac_cosim.models.runs.settings import TrainSettings
from isac_cosim.models.training.training import train_records
from tests.support.made_up import MADE_OF, SMALL_RUN

SMALL = CastformerSettings(width=16, heads=4, encoder_layers=1, feedforward=20)
FRAMES = 7


def core(settings: CastformerSettings = SMALL, widths: tuple[int, int] = (12, 9), classes: int = 6) -> CastformerCore:
    torch.manual_seed(1)
    return CastformerCore(settings, classes, *widths, speed=True).eval()


def streams_of(widths: tuple[int, int] = (12, 9), n: int = 3) -> tuple[Tensor, Tensor, Tensor]:
    torch.manual_seed(2)
    return torch.randn(n, FRAMES, widths[0]), torch.randn(n, FRAMES, widths[1]), torch.rand(n, FRAMES, 1)


def other(**changes: object) -> CastformerSettings:
    return CastformerSettings.model_validate({**SMALL.model_dump(), **changes})


@pytest.mark.parametrize("order", get_args(Order))
@pytest.mark.parametrize("attention", get_args(Attention))
@pytest.mark.parametrize("gradients", [True, False])
def test_a_change_at_a_frame_moves_nothing_before_it(order: Order, attention: Attention, gradients: bool) -> None:
    # Torch takes another path through its encoders without gradients.
    with torch.set_grad_enabled(gradients):
        assert_causal(order, attention)


def assert_causal(order: Order, attention: Attention) -> None:
    net, streams = core(other(order=order, attention=attention)), streams_of()
    before = net.states(*streams)
    for k, at in itertools.product(range(3), (1, FRAMES - 2)):
        changed = list(streams)
        changed[k] = streams[k].clone()
        changed[k][:, at] += 3
        after = net.states(*changed)
        moved = False
        for name in ("inner", "outer", "context", "intent"):
            first, second = getattr(before, name), getattr(after, name)
            torch.testing.assert_close(second[:, :at], first[:, :at], atol=1e-6, rtol=0)
            moved |= bool((second[:, at:] - first[:, at:]).abs().max() > 1e-4)
        assert moved


@pytest.mark.parametrize("modules", list(itertools.product([True, False], repeat=3)))
@pytest.mark.parametrize("order", get_args(Order))
@pytest.mark.parametrize(
    "options", [{"attention": attention} for attention in get_args(Attention)] + [{"residual": True}]
)
def test_the_last_frame_alone_is_that_of_all_frames(
    order: Order, modules: tuple[bool, bool, bool], options: dict[str, object]
) -> None:
    chosen = dict(zip(("rsf", "cpe", "fsn"), modules, strict=True))
    net, streams = core(other(order=order, **chosen, **options)), streams_of()
    whole, last = net.states(*streams), net.states(*streams, last=True)
    for name in ("inner", "outer", "context", "intent", "token"):
        if (expected := getattr(whole, name)) is None:
            assert getattr(last, name) is None
        else:
            torch.testing.assert_close(getattr(last, name)[:, -1], expected[:, -1], atol=1e-5, rtol=1e-4)


def test_only_the_last_frame_is_computed_where_nothing_later_reads_the_others() -> None:
    for order in get_args(Order):
        net = core(other(order=order))
        assert net.states(*streams_of(), last=True).inner.shape == (3, 1, 16)
        assert net.states(*streams_of()).inner.shape == (3, FRAMES, 16)


def test_with_bda_the_other_stream_is_seen_one_frame_late() -> None:
    attend = DelayedAttention(16, 4, 0.0, 1).eval()
    query, keys = torch.randn(2, FRAMES, 16), torch.randn(2, FRAMES, 16)
    changed = keys.clone()
    changed[:, 3] += 2
    moved = (attend(query, changed) - attend(query, keys)).abs().amax(dim=(0, 2))
    assert (moved > 1e-5).tolist() == [False] * 4 + [True] * 3


def test_the_mask_hides_the_future_and_the_zeros_in_front() -> None:
    visible = ~delayed_mask(4, 1)
    assert visible.int().tolist() == [[1, 0, 0, 0], [0, 1, 0, 0], [0, 1, 1, 0], [0, 1, 1, 1]]
    assert (~delayed_mask(3, 0)).int().tolist() == [[1, 0, 0], [1, 1, 0], [1, 1, 1]]
    assert (~delayed_mask(3, 2)).int().tolist() == [[1, 0, 0], [1, 0, 0], [0, 0, 1]]


def test_delayed_attention_is_attention_to_each_frame_s_past_alone() -> None:
    attend = DelayedAttention(16, 4, 0.0, 1).eval()
    query, keys = torch.randn(2, FRAMES, 16), torch.randn(2, FRAMES, 16)
    for t in range(1, FRAMES):
        past = keys[:, :t]
        expected = attend.attention(query[:, t : t + 1], past, past)[0][:, 0]
        torch.testing.assert_close(attend(query, keys)[:, t], expected, atol=1e-5, rtol=1e-4)


def test_the_running_mean_ends_at_the_mean_of_the_delayed_stream() -> None:
    x = torch.randn(2, FRAMES, 5)
    mean = running_mean(x, 1)
    torch.testing.assert_close(mean[:, -1], x[:, :-1].mean(dim=1))
    torch.testing.assert_close(mean[:, 0], torch.zeros(2, 5))
    torch.testing.assert_close(mean[:, 2], x[:, :2].mean(dim=1))
    torch.testing.assert_close(shifted(x, 1)[:, 1:], x[:, :-1])


def test_the_counterfactual_is_attention_to_the_mean_whatever_the_query() -> None:
    part = CausalResidual(16, 4, 0.0, 1, detach_mean=True).eval()
    stream = torch.randn(2, FRAMES, 16)
    mean = running_mean(stream, 1)
    answer = part.counterfactual(mean)
    for query in (torch.randn(2, 1, 16), torch.randn(2, 1, 16) * 5):
        keys = mean[:, -1:].expand(-1, FRAMES, -1)
        expected = part.attend.attention(query, keys, keys)[0][:, 0]
        torch.testing.assert_close(answer[:, -1], expected, atol=1e-5, rtol=1e-4)


def test_the_counterfactual_s_mean_has_a_gradient_where_asked() -> None:
    for detach in (True, False):
        mean = torch.randn(2, FRAMES, 16, requires_grad=True)
        total = CausalResidual(16, 4, 0.0, 1, detach).counterfactual(mean).sum()
        total.backward()
        assert (mean.grad is None) == detach


def test_a_mean_over_the_batch_is_that_of_all_frames_and_windows_in_training() -> None:
    part = CausalResidual(16, 4, 0.0, 1, detach_mean=True, mean_over="batch").train()
    other = torch.randn(3, FRAMES, 16)
    mean = part.mean(other)
    assert mean.shape == other.shape
    torch.testing.assert_close(mean[2, 5], other.reshape(-1, 16).mean(dim=0))
    torch.testing.assert_close(part.usual, 0.1 * mean[0, 0])


def test_with_a_mean_over_the_batch_an_answer_does_not_depend_on_its_company() -> None:
    part = CausalResidual(16, 4, 0.0, 1, detach_mean=True, mean_over="batch").train()
    for _ in range(200):
        part.mean(2.0 + 0.1 * torch.randn(8, FRAMES, 16))
    part.eval()
    stream, other = torch.randn(4, FRAMES, 16), torch.randn(4, FRAMES, 16)
    torch.testing.assert_close(part.mean(other), torch.full_like(other, 2.0), atol=0.05, rtol=0)
    torch.testing.assert_close(part(stream, other)[:1], part(stream[:1], other[:1]), atol=1e-5, rtol=1e-4)
    assert (part(stream, other) - stream).abs().max() > 1e-2


def test_the_mean_is_part_of_the_weights_only_where_it_is_over_the_batch() -> None:
    parts = {over: CausalResidual(16, 4, 0.0, 1, True, over) for over in get_args(MeanOver)}
    assert {over: "usual" in part.state_dict() for over, part in parts.items()} == {"window": False, "batch": True}


def test_the_residual_is_orthogonal_to_the_other_stream_s_mean() -> None:
    part = CausalResidual(16, 4, 0.0, 1, detach_mean=True).eval()
    stream, other_stream = torch.randn(2, FRAMES, 16), torch.randn(2, FRAMES, 16)
    residual = part.residual(stream, other_stream)
    inside = (residual * running_mean(other_stream, 1)).sum(dim=-1)
    assert residual[:, -1].abs().max() > 1e-2
    torch.testing.assert_close(inside, torch.zeros_like(inside), atol=1e-5, rtol=0)


def test_a_stream_that_stands_still_has_no_causal_effect() -> None:
    part = CausalResidual(16, 4, 0.0, 1, detach_mean=True).eval()
    stream, still = torch.randn(2, FRAMES, 16), torch.randn(2, 1, 16).expand(-1, FRAMES, -1)
    torch.testing.assert_close(part(stream, still), stream, atol=1e-5, rtol=0)


def test_the_channel_gate_is_equations_3_to_5() -> None:
    part, x = ChannelGate(16, 0.5).eval(), torch.randn(2, 3, 16)
    with torch.no_grad():
        part.norm.weight.copy_(torch.linspace(0.5, 2, 16))
    first, second = part.gate[0], part.gate[2]
    gate = 1 / (1 + torch.exp(-((x @ first.weight.T + first.bias).clamp(min=0) @ second.weight.T + second.bias)))
    gated = gate * x
    expected = gated * part.norm.weight / (gated.square().mean(dim=-1, keepdim=True) + 1e-6).sqrt()
    torch.testing.assert_close(part(x), expected)


def test_the_joint_logits_are_weighted_by_confidence() -> None:
    part, features = Confidence(4, 3, 0.2).eval(), torch.randn(2, 12)
    parts = [features[:, 4 * k : 4 * k + 4] for k in range(3)]
    power = torch.stack([torch.exp(x @ part.confidence[k].weight[0]) for k, x in enumerate(parts)])
    weight = power / power.sum(dim=0)
    logits = [x @ part.classify[k].weight.T + part.classify[k].bias for k, x in enumerate(parts)]
    expected = sum(weight[k][:, None] * logits[k] for k in range(3))
    torch.testing.assert_close(part(features), expected)


def test_the_loss_is_equation_12() -> None:
    by_name, label = core().training_logits(*streams_of()), torch.tensor([0, 3, 5])
    entropy = {name: nn.functional.cross_entropy(logits, label) for name, logits in by_name.items()}
    assert set(entropy) == {"joint", "in", "out", "context", "intent"}
    expected = (entropy["in"] + entropy["out"] + entropy["context"] + entropy["joint"]) / 4 + 0.3 * entropy["intent"]
    torch.testing.assert_close(castformer_loss(by_name, label, None, 0.3), expected)


@pytest.mark.parametrize(("rsf", "cpe", "fsn"), list(itertools.product([True, False], repeat=3)))
@pytest.mark.parametrize(("widths", "classes"), [((240, 60), 6), ((65, 33), 5)])
def test_all_combinations_and_widths(rsf: bool, cpe: bool, fsn: bool, widths: tuple[int, int], classes: int) -> None:
    net = core(other(rsf=rsf, cpe=cpe, fsn=fsn, dropout=0.0), widths, classes).train()
    streams = streams_of(widths)
    by_name = net.training_logits(*streams)
    assert all(logits.shape == (3, classes) for logits in by_name.values())
    assert ("intent" in by_name) == cpe
    assert ("context" in by_name) == fsn
    torch.testing.assert_close(net(*streams), by_name["joint"])
    castformer_loss(by_name, torch.tensor([0, 1, 2]), None, 0.1).backward()
    assert_gradients(net)


def assert_gradients(net: CastformerCore) -> None:
    """Assert that every parameter has a gradient.

    The output bias of CPE's attention is in the observed and in the counterfactual attention, and cancels.
    """
    cancels = {f"{name}.attend.attention.out_proj.bias" for name, m in net.named_modules() if type(m) is CausalResidual}
    for name, parameter in net.named_parameters():
        assert parameter.grad is not None, name
        assert name in cancels or parameter.grad.abs().sum() > 0, name


@pytest.mark.parametrize("order", get_args(Order))
def test_every_order_has_gradients_everywhere(order: Order) -> None:
    net = core(other(order=order, dropout=0.0)).train()
    castformer_loss(net.training_logits(*streams_of()), torch.tensor([0, 1, 2]), None, 0.1).backward()
    assert_gradients(net)
    assert len({core(other(order=o))(*streams_of()).sum().item() for o in get_args(Order)}) == 4


def test_options_change_the_answer() -> None:
    plain = core()(*streams_of())
    options = [{"attention": a} for a in get_args(Attention) if a != "bda"]
    options += [{"residual": True}, {"delay_frames": 0}, {"intent_source": "out"}, {"causal_encoder": False}]
    for option in options:
        assert (core(other(**option))(*streams_of()) - plain).abs().max() > 1e-5, option


def test_a_sample_s_answer_does_not_depend_on_its_batch() -> None:
    net, streams = core(), streams_of(n=5)
    alone = torch.cat([net(*(x[k : k + 1] for x in streams)) for k in range(5)])
    torch.testing.assert_close(net(*streams), alone, atol=1e-5, rtol=1e-4)


def test_positions_are_vaswani_s() -> None:
    code = positions(5, 6)
    torch.testing.assert_close(code[3, 2], torch.sin(torch.tensor(3 / 10_000 ** (2 / 6))))
    torch.testing.assert_close(code[3, 3], torch.cos(torch.tensor(3 / 10_000 ** (2 / 6))))


def test_frames_hold_the_window_s_samples_and_the_tv_s_speed_in_m_s() -> None:
    net = Castformer(SMALL, WindowShape(6, 880, 220, 400.0, 100.0)).eval()
    tv, uv = torch.randn(2, 6, 880), torch.randn(2, 6, 220)
    net.set_scale(torch.arange(6.0), torch.arange(1.0, 7.0), torch.zeros(6), torch.ones(6))
    inner, outer, speed = net.frames(*net.standardised(tv, uv))
    assert inner.shape == (2, 22, 240)
    assert outer.shape == (2, 22, 60)
    torch.testing.assert_close(outer[1, 3], uv[1, :, 30:40].flatten())
    expected = torch.hypot(tv[:, 2, 39::40], tv[:, 3, 39::40]) / 10
    torch.testing.assert_close(speed[:, :, 0], expected, atol=1e-4, rtol=1e-3)
    torch.testing.assert_close(net.classify(net.features(tv, uv)), net.training_logits(tv, uv)["joint"])


def test_samples_that_fill_no_frame_are_left_out_in_front() -> None:
    x = torch.randn(1, 6, 13)
    torch.testing.assert_close(in_frames(x, 4, 3)[0, 0], x[0, :, 1:5].flatten())
    net = Castformer(SMALL, WindowShape(6, 90, 23, 400.0, 100.0))
    assert net.frames(torch.zeros(1, 6, 90), torch.zeros(1, 6, 23))[2].shape == (1, 2, 1)
    with pytest.raises(InputError, match="frame_s"):
        Castformer(SMALL, WindowShape(6, 60, 15, 400.0, 100.0))


def test_heads_divide_the_width() -> None:
    with pytest.raises(ValueError, match="not a multiple of heads"):
        CastformerSettings(width=20, heads=8)


def test_the_paper_s_optimiser_has_the_settings_names() -> None:
    assert OptimiserSettings.model_validate(PAPER_OPTIMISER).batch == 16


def test_the_parameter_count_by_hand() -> None:
    net = core(other(rsf=False, cpe=False, fsn=False, heads=1))
    layer = (3 * 16 + 16) * 16 + 4 * 16 + (16 * 20 + 20) + (20 * 16 + 16) + 4 * 16
    expected = (12 * 16 + 16) + (9 * 16 + 16) + 2 * (layer + 2 * 16) + (32 * 6 + 6)
    assert sum(p.numel() for p in net.parameters()) == expected


def test_it_trains_in_the_one_loop(records: Records, tmp_path: Path) -> None:
    settings = TrainSettings.model_validate(
        {**SMALL_RUN.model_dump(), "model": "castformer", "castformer": SMALL.model_dump()}
    )
    run = train_records(records, MADE_OF, tmp_path / "run", settings)
    assert run.name == "CaSTFormer"
    assert run.card.validation_macro_f1 is not None
    assert run.card.validation_macro_f1 > 0.4
    assert run.card.parameters == sum(p.numel() for p in run.predictor.network.parameters())  # type: ignore[attr-defined]
