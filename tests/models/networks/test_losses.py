"""The focal cost function against a hand computation and against cross-entropy."""

import math

import numpy as np
import pytest
import torch

from isac_cosim.models.networks.losses import focal_loss, inverse_frequency


def test_by_hand() -> None:
    logits = torch.log(torch.tensor([[0.7, 0.2, 0.1], [0.3, 0.3, 0.4]]))
    by_hand = (2.0 * 0.3**2 * -math.log(0.7) + 0.5 * 0.6**2 * -math.log(0.4)) / 2
    loss = focal_loss(logits, torch.tensor([0, 2]), torch.tensor([2.0, 1.0, 0.5]), gamma=2.0)
    assert float(loss) == pytest.approx(by_hand, rel=1e-6)


def test_without_focus_it_is_cross_entropy() -> None:
    torch.manual_seed(0)
    logits, label = torch.randn(50, 6), torch.randint(0, 6, (50,))
    torch.testing.assert_close(focal_loss(logits, label, gamma=0.0), torch.nn.functional.cross_entropy(logits, label))


def test_easy_samples_count_less_with_focus() -> None:
    label = torch.tensor([0])
    easy, hard = torch.tensor([[4.0, 0.0]]), torch.tensor([[-4.0, 0.0]])

    def ratio(gamma: float) -> float:
        return float(focal_loss(easy, label, gamma=gamma) / focal_loss(hard, label, gamma=gamma))

    assert ratio(2.0) < 0.01 * ratio(0.0)


def test_extreme_logits_stay_finite() -> None:
    logits = torch.tensor([[200.0, -200.0], [-200.0, 200.0]], requires_grad=True)
    loss = focal_loss(logits, torch.tensor([0, 0]))
    loss.backward()
    assert torch.isfinite(loss)
    assert logits.grad is not None
    assert torch.isfinite(logits.grad).all()


def test_class_weights_are_inverse_frequencies_of_mean_one() -> None:
    label = np.array([0] * 6 + [1] * 3 + [3] * 1)
    alpha = inverse_frequency(label, 4).double().numpy()
    assert alpha[2] == 0
    assert alpha[0] * 6 == pytest.approx(alpha[1] * 3, rel=1e-6)
    assert alpha[0] * 6 == pytest.approx(alpha[3] * 1, rel=1e-6)
    assert alpha[label].mean() == pytest.approx(1.0, rel=1e-6)
