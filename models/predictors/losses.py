"""The focal cost function of ASI-BIP, Eq. (6)."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import torch
from pydantic import Field
from torch import Tensor

from isacsim.settings import Settings


class LossSettings(Settings):
    """Parameters of the focal cost function."""

    gamma: float = Field(2.0, ge=0, description="focusing parameter; 0 is weighted cross-entropy")
    exposure_weight: float = Field(
        0.0,
        ge=0,
        description="of outlier exposure: on preludes all intentions shall be equally likely; 0 leaves it out",
    )
    class_weights: bool = Field(True, description="alpha is the inverse class frequency; otherwise 1 for every class")


def exposure_loss(logits: Tensor) -> Tensor:
    """Mean cross-entropy of logits (E, G) of outliers against equal probabilities: a scalar.

    Source: Hendrycks, Mazeika & Dietterich 2019, the form for classifiers.
    """
    return -torch.log_softmax(logits.float(), dim=1).mean()


def inverse_frequency(label: npt.NDArray[np.int64], n_classes: int) -> Tensor:
    """Class weights alpha, (n_classes,): inverse frequencies, scaled so that the mean weight of a sample is 1.

    A class without samples gets weight 0.
    """
    count = np.bincount(label, minlength=n_classes)[:n_classes]
    weight = np.where(count > 0, len(label) / np.maximum(count, 1) / max((count > 0).sum(), 1), 0.0)
    return torch.as_tensor(weight, dtype=torch.float32)


def focal_loss(logits: Tensor, label: Tensor, alpha: Tensor | None = None, gamma: float = 2.0) -> Tensor:
    """Mean over the batch of -alpha_g (1 - p_g)^gamma log(p_g), g the true class: a scalar.

    logits: (E, G). label: (E,) int64. alpha: (G,), 1 where not given. Source: Eq. (6) of ASI-BIP.
    """
    log_p = torch.log_softmax(logits, dim=1).gather(1, label[:, None])[:, 0]
    loss = -((1 - log_p.exp()) ** gamma) * log_p
    if alpha is not None:
        loss = loss * alpha[label]
    return loss.mean()
