"""Scores of the unknown class by their definitions, and AUROC by counting pairs."""

import numpy as np
import pytest
import torch

from isac_cosim.models.predictors.protocol import Outputs
from isac_cosim.models.scores import open_set


def outputs(n: int = 40, seed: int = 0) -> Outputs:
    rng = np.random.default_rng(seed)
    return Outputs(rng.normal(0, 3, (n, 6)), rng.normal(0, 1, (n, 5)))


def reference() -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(1)
    label = rng.integers(0, 3, 400)
    return (rng.normal(0, 1, (400, 5)) + 6 * label[:, None]).astype(np.float32), label


def test_scores_of_logits() -> None:
    answers = outputs()
    logits = torch.from_numpy(answers.logits)
    spread = torch.distributions.Categorical(logits=logits)
    expected = {
        "msp": torch.softmax(logits, 1).amax(1),
        "max_logit": logits.amax(1),
        "energy": torch.logsumexp(logits, 1),
        "entropy": -spread.entropy(),
    }
    scores = open_set.scores(reference())
    for name, value in expected.items():
        np.testing.assert_allclose(scores[name](answers), value.numpy(), atol=1e-12)


def test_neighbours_by_brute_force() -> None:
    features, _ = reference()
    answers = outputs()
    mean, sd = features.mean(axis=0, dtype=float), features.std(axis=0, dtype=float)
    apart = np.linalg.norm(((answers.features - mean) / sd)[:, None] - (features - mean) / sd, axis=2)
    expected = -np.sort(apart, axis=1)[:, open_set.NEIGHBOURS - 1]
    np.testing.assert_allclose(open_set.scores(reference())["knn"](answers), expected, rtol=1e-5)


def test_mahalanobis_of_round_classes_is_the_distance_to_the_nearest_mean() -> None:
    features, label = reference()
    means = np.stack([features[label == g].mean(axis=0) for g in range(3)])
    answers = Outputs(np.zeros((30, 6)), np.random.default_rng(2).normal(6, 8, (30, 5)))
    round_distance = ((answers.features[:, None] - means) ** 2).sum(axis=2).min(axis=1)
    squared = -open_set.scores((features, label))["mahalanobis"](answers)
    np.testing.assert_allclose(squared, round_distance, rtol=0.25)


def test_auroc_counts_pairs() -> None:
    rng = np.random.default_rng(3)
    known, unknown = rng.normal(1, 1, 60), rng.normal(0, 1, 45).round(1)
    pairs = (known[:, None] > unknown).mean() + 0.5 * (known[:, None] == unknown).mean()
    assert open_set.auroc(known, unknown) == pytest.approx(pairs)
    assert open_set.auroc(known, unknown[:0]) is None


def test_the_threshold_keeps_its_share_of_the_known() -> None:
    rng = np.random.default_rng(4)
    known = rng.normal(size=2000)
    assert (known >= open_set.threshold_at_recall(known)).mean() == pytest.approx(0.95, abs=0.002)
    assert open_set.accepted_unknown(known, known - 100) == 0
    assert open_set.accepted_unknown(known, known + 100) == 1
