"""A predictor in use gives the answers that evaluation measured."""

import numpy as np
import pytest
import torch

from isac_cosim.models.data.windows import Ends, Records, cut
from isac_cosim.models.inference import Infer
from isac_cosim.models.predictors.aligned import Aligned, AlignedPredictor
from isac_cosim.models.predictors.asi_bip import AsiBip, TvAlonePredictor, UvAlonePredictor
from isac_cosim.models.runs.run import Run
from isac_cosim.models.scores.open_set import chosen
from tests.support.made_up import SMALL_RUN

ENDS = Ends(np.array([0, 1, 6]), np.array([300, 350, 400]))


def streams(records: Records, run: Run) -> tuple[np.ndarray, np.ndarray]:
    """The windows at ENDS, cut by hand, in the scenario's plane."""
    tv, uv = run.card.tv_length, run.card.uv_length
    cuts = list(zip(ENDS.row, ENDS.step, strict=True))
    return (
        np.stack([records.tv[k, :, 4 * end + 1 - tv : 4 * end + 1] for k, end in cuts]),
        np.stack([records.uv[k, :, end + 1 - uv : end + 1] for k, end in cuts]),
    )


@pytest.mark.parametrize("kind", ["network_run", "trees_run"])
def test_a_batch_is_answered_as_in_evaluation(kind: str, records: Records, request: pytest.FixtureRequest) -> None:
    run: Run = request.getfixturevalue(kind)
    inference = Infer.load(run.path)(*streams(records, run))
    outputs = run.predictor(cut(records, ENDS, run.card.settings.windows))
    expected = torch.softmax(torch.from_numpy(outputs.logits) / run.card.temperature, 1).numpy()
    np.testing.assert_allclose(inference.probabilities, expected, atol=1e-6)
    assert run.card.unknown_threshold is not None
    score = chosen(run)(outputs)
    np.testing.assert_array_equal(inference.rejected, score < run.card.unknown_threshold)
    assert inference.intentions == [run.card.classes[k] for k in outputs.logits.argmax(axis=1)]
    assert inference.latency_ms > 0


def test_one_window_is_a_batch_of_one(records: Records, network_run: Run) -> None:
    infer = Infer.load(network_run.path)
    tv, uv = streams(records, network_run)
    np.testing.assert_allclose(infer(tv[1], uv[1]).probabilities[0], infer(tv, uv).probabilities[1], atol=1e-5)


def test_windows_of_another_length_are_refused(records: Records, network_run: Run) -> None:
    tv, uv = streams(records, network_run)
    with pytest.raises(ValueError, match="trained on"):
        Infer.load(network_run.path)(tv[:, :, 1:], uv)


@pytest.mark.parametrize(("kind", "ignored"), [(TvAlonePredictor, 1), (UvAlonePredictor, 0)])
def test_a_single_stream_floor_ignores_the_other_stream(
    network_run: Run, kind: type[TvAlonePredictor], ignored: int
) -> None:
    network = kind.build(SMALL_RUN, network_run.card.shape).eval()
    assert isinstance(network, AsiBip)
    streams = [torch.randn(2, 6, 480), torch.randn(2, 6, 120)]
    logits = network(*streams)
    for k in (0, 1):
        changed = [x + 1 if j == k else x for j, x in enumerate(streams)]
        assert torch.equal(network(*changed), logits) == (k == ignored)


def test_aligned_fusion_sees_both_streams_at_the_same_instants(network_run: Run) -> None:
    network = AlignedPredictor.build(SMALL_RUN, network_run.card.shape).eval()
    assert isinstance(network, Aligned)
    inputs: list[torch.Tensor] = []
    network.lstm.register_forward_pre_hook(lambda _, args: inputs.append(args[0]))
    ramp_tv, ramp_uv = (torch.linspace(0, 1, n).expand(1, 6, n) for n in (480, 120))
    assert network(ramp_tv, ramp_uv).shape == (1, 6)
    torch.testing.assert_close(inputs[0][:, 0, 0], inputs[0][:, 0, 6])
    assert inputs[0].shape == (220, 1, 12)
