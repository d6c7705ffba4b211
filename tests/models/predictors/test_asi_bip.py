"""The ASI-BIP network: tokens, standardisation, independence of the batch, gradients."""

import pytest
import torch
from torch import nn

from isac_cosim.models.data.statistics import recent_motion, statistics
from isac_cosim.models.data.windows import Windows
from isac_cosim.models.networks.lstms import has_bfloat16
from isac_cosim.models.networks.statistics_branch import RecentMotionBranch, window_statistics
from isac_cosim.models.predictors import asi_bip
from isac_cosim.models.predictors.asi_bip import (
    AsiBip,
    AsiBipSettings,
    Branch,
    ClassTokenEncoder,
    patches,
    resampled,
    tokens_of,
)

SMALL = AsiBipSettings(hidden=6, width=16, heads=4, feedforward=20)


def network(settings: AsiBipSettings = SMALL, tv: int = 80, uv: int = 20) -> AsiBip:
    torch.manual_seed(1)
    return AsiBip(settings, 6, tv, uv).eval()


def count_tokens(net: AsiBip, tv: int, uv: int) -> int:
    counts: list[int] = []
    net.encoder.register_forward_pre_hook(lambda _, args: counts.append(args[0].shape[1]))
    net(torch.randn(2, 6, tv), torch.randn(2, 6, uv))
    return counts[0]


def test_the_paper_s_window_gives_44_and_44_tokens_and_a_class_token() -> None:
    assert count_tokens(network(tv=880, uv=220), 880, 220) == 1 + 44 + 44


def test_the_literal_reading_has_1101_tokens() -> None:
    net = network(SMALL.model_copy(update={"tokens": "literal"}), tv=880, uv=220)
    assert count_tokens(net, 880, 220) == 1101


def test_lengths_that_the_pools_do_not_divide_keep_their_tail() -> None:
    net = network(tv=83, uv=22)
    tv, uv = torch.randn(1, 6, 83), torch.randn(1, 6, 22)
    changed = tv.clone()
    changed[..., -1] += 5
    assert count_tokens(net, 83, 22) == 1 + 5 + 5
    assert (net(tv, uv) - net(changed, uv)).abs().max() > 1e-6


def test_a_branch_is_lstm_mean_projection_and_embeddings() -> None:
    torch.manual_seed(2)
    branch = Branch(SMALL, 40, 1, 20).eval()
    x = torch.randn(3, 6, 40)
    cell = nn.LSTM(6, 6, batch_first=True, bidirectional=True)
    cell.load_state_dict(branch.lstm.state_dict())
    mean = cell(x.transpose(1, 2))[0].reshape(3, 2, 20, 12).mean(dim=2)
    expected = mean @ branch.project.weight.T + branch.project.bias + branch.position + branch.stream
    torch.testing.assert_close(tokens_of([branch], [x])[0], expected)


def test_standardisation_is_part_of_the_network_and_of_its_state() -> None:
    plain, scaled = network(), network()
    mean, sd = torch.arange(6.0), torch.arange(1.0, 7.0)
    scaled.set_scale(mean, sd, 2 * mean, 3 * sd)
    tv, uv = torch.randn(2, 6, 80), torch.randn(2, 6, 20)
    expected = plain((tv - mean[:, None]) / sd[:, None], (uv - 2 * mean[:, None]) / (3 * sd[:, None]))
    torch.testing.assert_close(scaled(tv, uv), expected)
    again = network()
    again.load_state_dict(scaled.state_dict())
    torch.testing.assert_close(again(tv, uv), expected)


def test_the_scale_is_that_of_the_windows_it_is_fitted_on() -> None:
    tv, uv = 3 + 5 * torch.randn(40, 6, 80), torch.randn(40, 6, 20) - 7
    net = network(SMALL.model_copy(update={"statistics": True}))
    net.fit_scale(tv, uv)
    for x in net.standardised(tv, uv):
        torch.testing.assert_close(x.mean(dim=(0, 2)), torch.zeros(6), atol=1e-4, rtol=0)
        torch.testing.assert_close(x.std(dim=(0, 2)), torch.ones(6), atol=1e-2, rtol=0)
    inputs: list[torch.Tensor] = []
    assert net.statistics is not None
    net.statistics.mlp.register_forward_pre_hook(lambda _, args: inputs.append(args[0]))
    net(tv, uv)
    torch.testing.assert_close(inputs[0].mean(dim=0), torch.zeros(120), atol=1e-3, rtol=0)
    torch.testing.assert_close(inputs[0].std(dim=0, correction=0), torch.ones(120), atol=1e-3, rtol=0)


@pytest.mark.parametrize(("tv", "uv"), [(90, 30), (80, 20), (83, 22)])
def test_statistics_are_those_that_the_trees_see(tv: int, uv: int) -> None:
    streams = torch.randn(4, 6, tv), torch.randn(4, 6, uv)
    expected = statistics(Windows(*(x.numpy() for x in streams)))
    torch.testing.assert_close(window_statistics(*streams), torch.from_numpy(expected), atol=1e-5, rtol=1e-4)


def test_statistics_change_the_answer_and_nothing_of_the_other_branches() -> None:
    with_statistics = network(SMALL.model_copy(update={"statistics": True}))
    plain = network()
    missing, more = plain.load_state_dict(with_statistics.state_dict(), strict=False)
    assert not missing
    assert all(name.startswith("statistics.") for name in more)
    tv, uv = torch.randn(2, 6, 80), torch.randn(2, 6, 20)
    assert (with_statistics(tv, uv) - plain(tv, uv)).abs().max() > 1e-3
    with torch.no_grad():
        for parameter in with_statistics.statistics.mlp[-1].parameters():  # type: ignore[union-attr]
            parameter.zero_()
    torch.testing.assert_close(with_statistics(tv, uv), plain(tv, uv))


@pytest.mark.parametrize(("length", "rate_hz"), [(880, 400.0), (80, 400.0), (7, 10.0)])
def test_the_token_of_recent_motion_has_the_columns_of_the_trees(length: int, rate_hz: float) -> None:
    tv = 5 * torch.randn(4, 6, length)
    expected = recent_motion(Windows(tv.numpy(), tv.numpy()), rate_hz)
    torch.testing.assert_close(
        RecentMotionBranch(length, rate_hz, 8).columns(tv), torch.from_numpy(expected), atol=1e-3, rtol=1e-4
    )


def test_recent_motion_changes_the_answer_by_the_tv_alone() -> None:
    net = AsiBip(SMALL, 6, 80, 20, recent_hz=400.0).eval()
    tv, uv = torch.randn(2, 6, 80), torch.randn(2, 6, 20)
    net.fit_scale(tv, uv)
    assert net.recent is not None
    inputs: list[torch.Tensor] = []
    net.recent.mlp.register_forward_pre_hook(lambda _, args: inputs.append(args[0]))
    plain = network()
    _, more = plain.load_state_dict(net.state_dict(), strict=False)
    assert more
    assert all(name.startswith("recent.") for name in more)
    assert (net(tv, uv) - plain(tv, uv)).abs().max() > 1e-4
    net(tv, uv + 5)
    assert torch.equal(*inputs)


def test_with_one_stream_statistics_are_of_that_one() -> None:
    torch.manual_seed(1)
    alone = AsiBip(SMALL.model_copy(update={"statistics": True}), 6, 80, 20, "tv").eval()
    tv, uv = torch.randn(2, 6, 80), torch.randn(2, 6, 20)
    alone.fit_scale(tv, uv)
    torch.testing.assert_close(alone(tv, uv), alone(tv, uv + 5))


@pytest.mark.parametrize("statistics", [False, True])
def test_a_window_s_answer_does_not_depend_on_its_batch(statistics: bool) -> None:
    net = network(SMALL.model_copy(update={"statistics": statistics}))
    tv, uv = torch.randn(5, 6, 80), torch.randn(5, 6, 20)
    alone = torch.cat([net(tv[k : k + 1], uv[k : k + 1]) for k in range(5)])
    torch.testing.assert_close(net(tv, uv), alone, atol=1e-5, rtol=1e-4)


@pytest.mark.parametrize("extra", [{"tokens": "pooled"}, {"tokens": "literal"}, {"statistics": True}])
def test_every_parameter_and_both_streams_get_gradients(extra: dict[str, object]) -> None:
    net = network(SMALL.model_copy(update={**extra, "dropout": 0.0})).train()
    tv = torch.randn(3, 6, 80, requires_grad=True)
    uv = torch.randn(3, 6, 20, requires_grad=True)
    nn.functional.cross_entropy(net(tv, uv), torch.tensor([0, 1, 2])).backward()
    for name, parameter in net.named_parameters():
        assert parameter.grad is not None, name
        assert parameter.grad.abs().sum() > 0, name
    for stream in (tv, uv):
        assert stream.grad is not None
        assert (stream.grad.abs().sum(dim=(0, 2)) > 0).all()


def test_logits_are_read_from_the_features() -> None:
    net = network()
    tv, uv = torch.randn(2, 6, 80), torch.randn(2, 6, 20)
    torch.testing.assert_close(net.classify(net.features(tv, uv)), net(tv, uv))


def test_attention_dropout_is_a_setting_of_its_own() -> None:
    net = network(SMALL.model_copy(update={"dropout": 0.3, "attention_dropout": 0.2}))
    assert [layer.self_attn.dropout for layer in net.encoder.layers] == [0.2, 0.2]
    assert [layer.dropout.p for layer in net.encoder.layers] == [0.3, 0.3]


@pytest.mark.parametrize("norm_first", [True, False])
@pytest.mark.parametrize("training", [True, False])
def test_the_class_token_is_that_of_a_whole_encoder(norm_first: bool, training: bool) -> None:
    settings = SMALL.model_copy(update={"norm_first": norm_first, "dropout": 0.0, "encoder_layers": 3})
    encoder = ClassTokenEncoder(settings).train(training)
    layer = nn.TransformerEncoderLayer(16, 4, 20, 0.0, "gelu", batch_first=True, norm_first=norm_first)
    whole = nn.TransformerEncoder(layer, 3, enable_nested_tensor=False).train(training)
    whole.load_state_dict(encoder.state_dict())
    tokens = torch.randn(3, 9, 16)
    torch.testing.assert_close(encoder(tokens), whole(tokens)[:, 0])


def test_patches_are_samples_side_by_side_up_to_the_window_s_end() -> None:
    x = torch.randn(2, 6, 11)
    steps = patches(x, 4)
    assert steps.shape == (3, 2, 24)
    for component in range(6):
        torch.testing.assert_close(steps[2, 1, 4 * component : 4 * component + 4], x[1, component, 7:])
        first = torch.stack([x[1, component, k] for k in (0, 0, 1, 2)])
        torch.testing.assert_close(steps[0, 1, 4 * component : 4 * component + 4], first)


def test_patches_shorten_the_lstms_and_keep_the_tokens() -> None:
    net = network(SMALL.model_copy(update={"tv_patch": 10, "uv_patch": 5}), tv=880, uv=220)
    assert isinstance(net.tv_branch, Branch)
    assert isinstance(net.uv_branch, Branch)
    assert count_tokens(net, 880, 220) == 1 + 44 + 44
    assert net.tv_branch.steps(torch.zeros(1, 6, 880)).shape == (88, 1, 60)
    assert net.uv_branch.steps(torch.zeros(1, 6, 220)).shape == (44, 1, 30)


def test_a_patched_branch_that_weighs_its_samples_alike_sees_their_mean() -> None:
    patched, plain = (
        network(SMALL.model_copy(update={"tv_patch": 4})),
        network(SMALL.model_copy(update={"tv_pool": 5}), tv=20),
    )
    state = plain.state_dict()
    for name in ("weight_ih_l0", "weight_ih_l0_reverse"):
        state[f"tv_branch.lstm.{name}"] = state[f"tv_branch.lstm.{name}"].repeat_interleave(4, dim=1) / 4
    patched.load_state_dict(state)
    tv, uv = torch.randn(2, 6, 80), torch.randn(2, 6, 20)
    torch.testing.assert_close(patched(tv, uv), plain(tv.reshape(2, 6, 20, 4).mean(dim=3), uv))


def test_tokens_hold_whole_patches() -> None:
    with pytest.raises(ValueError, match="not a whole number of patches"):
        AsiBipSettings(tv_patch=8)
    assert AsiBipSettings(tv_patch=8, tokens="literal").tv_patch == 8


def test_heads_divide_the_width() -> None:
    with pytest.raises(ValueError, match="not a multiple of heads"):
        AsiBipSettings(width=100, heads=8)


@pytest.mark.skipif(not has_bfloat16(), reason="the processor does not compute in bfloat16")
def test_bfloat16_lstms_only_train_so() -> None:
    plain, coarse = in_both_precisions()
    tv, uv = torch.randn(2, 6, 80), torch.randn(2, 6, 20)
    torch.testing.assert_close(coarse(tv, uv), plain(tv, uv))
    apart = (coarse.train()(tv, uv) - plain(tv, uv)).abs().max()
    assert 0 < apart < 0.1


def test_lstms_train_in_float32_where_the_processor_lacks_bfloat16(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(asi_bip, "has_bfloat16", lambda: False)
    plain, coarse = in_both_precisions()
    tv, uv = torch.randn(2, 6, 80), torch.randn(2, 6, 20)
    assert torch.equal(coarse.train()(tv, uv), plain.train()(tv, uv))
    assert [plain.lstm_precision, coarse.lstm_precision] == ["float32", "float32"]
    monkeypatch.setattr(asi_bip, "has_bfloat16", lambda: True)
    assert [plain.lstm_precision, coarse.lstm_precision] == ["float32", "bfloat16"]


def in_both_precisions() -> list[AsiBip]:
    """Return two networks without dropout and with the same weights; the second trains its LSTMs in bfloat16."""
    plain, coarse = (
        network(SMALL.model_copy(update={"lstm_bfloat16": switch, "dropout": 0.0})) for switch in (False, True)
    )
    coarse.load_state_dict(plain.state_dict())
    return [plain, coarse]


def test_at_one_rate_there_are_as_many_tokens_and_parameters() -> None:
    own = AsiBip(SMALL, 6, 880, 220)
    for rates in ("slow", "fast"):
        torch.manual_seed(1)
        net = AsiBip(SMALL, 6, 880, 220, rates=rates).eval()
        assert net.parameter_count == own.parameter_count
        assert count_tokens(net, 880, 220) == 1 + 44 + 44


def test_the_controls_see_streams_of_one_rate() -> None:
    seen: list[tuple[int, ...]] = []
    expected = {"own": [80, 20], "slow": [20, 20], "fast": [80, 80]}
    for rates, lengths in expected.items():
        net = AsiBip(SMALL, 6, 80, 20, rates=rates).eval()  # type: ignore[arg-type]
        for branch in (net.tv_branch, net.uv_branch):
            assert branch is not None
            branch.register_forward_pre_hook(lambda _, given: seen.append(given[0].shape))
        seen.clear()
        net(torch.randn(2, 6, 80), torch.randn(2, 6, 20))
        assert [shape[0] for shape in seen] == lengths


def test_resampling_is_linear_and_keeps_both_ends() -> None:
    line = torch.linspace(3.0, 7.0, 80).expand(1, 6, 80)
    for length in (20, 80, 317):
        assert torch.allclose(resampled(line, length), torch.linspace(3.0, 7.0, length).expand(1, 6, length), atol=1e-5)
