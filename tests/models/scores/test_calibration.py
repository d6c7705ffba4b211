"""Temperature and calibration error on made-up answers of known calibration."""

import numpy as np
import pytest
from scipy.special import softmax

from isac_cosim.models.scores.calibration import calibration_error, fit_temperature


def sharpened_logits(sharpening: float, n: int = 20000) -> tuple[np.ndarray, np.ndarray]:
    """Return logits that are `sharpening` times those from which the labels were drawn, and the labels."""
    rng = np.random.default_rng(5)
    logits = rng.normal(0, 1.5, (n, 4))
    p = softmax(logits, axis=1)
    label = (rng.random((n, 1)) > p.cumsum(axis=1)).sum(axis=1)
    return sharpening * logits, label


@pytest.mark.parametrize("sharpening", [0.5, 1.0, 4.0])
def test_temperature_undoes_the_sharpening(sharpening: float) -> None:
    logits, label = sharpened_logits(sharpening)
    temperature = fit_temperature(logits, label)
    assert temperature == pytest.approx(sharpening, rel=0.05)
    assert calibration_error(softmax(logits / temperature, axis=1), label) < 0.015


def test_too_sure_answers_are_miscalibrated() -> None:
    logits, label = sharpened_logits(4.0)
    assert calibration_error(softmax(logits, axis=1), label) > 0.1


def test_error_by_hand() -> None:
    p = np.array([[0.9, 0.1], [0.9, 0.1], [0.6, 0.4], [0.4, 0.6]])
    by_hand = 0.5 * abs(0.9 - 0.5) + 0.5 * abs(0.6 - 1.0)
    assert calibration_error(p, np.array([0, 1, 0, 1])) == pytest.approx(by_hand)


def test_without_windows_the_temperature_is_one() -> None:
    assert fit_temperature(np.zeros((0, 4)), np.zeros(0, int)) == 1.0
