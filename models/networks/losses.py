"""Losses of networks: the focal loss of ASI-BIP, Eq. (6), with its class weights, and outlier exposure."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from isac_cosim.base.arrays import IntArray


def exposure_loss(logits: Tensor) -> Tensor:
    """Return the mean cross-entropy of the logits (E, G) of outliers against equal probabilities: a scalar.

    Source: Hendrycks, Mazeika & Dietterich 2019, the form for classifiers.
    """
    return -torch.log_softmax(logits.float(), dim=1).mean()


def inverse_frequency(label: IntArray, n_classes: int) -> Tensor:
    """Return class weights alpha, (n_classes,): inverse frequencies, scaled so that the mean weight of a sample is 1.

    label: (n,). A class without samples gets weight 0.
    """
    count = np.bincount(label, minlength=n_classes)[:n_classes]
    weight = np.where(count > 0, len(label) / np.maximum(count, 1) / max((count > 0).sum(), 1), 0.0)
    return torch.as_tensor(weight, dtype=torch.float32)


def focal_loss(logits: Tensor, label: Tensor, alpha: Tensor | None = None, gamma: float = 2.0) -> Tensor:
    """Return the mean over the batch of -alpha_g (1 - p_g)^gamma log(p_g), where g is the true class: a scalar.

    logits: (E, G). label: (E,), int64. alpha: class weights (G,), all 1 if None. gamma: focusing parameter.
    Source: Eq. (6) of ASI-BIP.
    """
    log_p = torch.log_softmax(logits, dim=1).gather(1, label[:, None])[:, 0]
    loss = -((1 - log_p.exp()) ** gamma) * log_p
    if alpha is not None:
        loss = loss * alpha[label]
    return loss.mean()
