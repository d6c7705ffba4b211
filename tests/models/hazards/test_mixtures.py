"""Densities against scikit-learn's own, odds against Bayes' rule multiplied out; other files are refused."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import norm
from sklearn.mixture import GaussianMixture

from isac_cosim.base.errors import InputError
from isac_cosim.models.data.fit_settings import FitSettings
from isac_cosim.models.data.windows import WindowSettings
from isac_cosim.models.hazards.mixtures import (
    MIXTURES_FILE,
    FittedMixtures,
    GaussianMixtures,
    Hypotheses,
    Mixture,
    _hypotheses,
)
from isac_cosim.models.hazards.predictor import NEVER, HazardFacts
from isac_cosim.models.hazards.settings import MixturesSettings
from isac_cosim.models.predictors.protocol import WindowShape

SHAPE = WindowShape(6, 880, 220, 400.0, 100.0)
SETTINGS = MixturesSettings()
NORMAL = Mixture(share=(1.0,), mean=(0.0,), sd=(1.0,))
number = st.floats(-3, 3)


def test_two_bumps_take_two_normal_distributions_and_one_takes_one() -> None:
    rng = np.random.default_rng(1)
    one = rng.normal(2.0, 0.5, 2000)
    two = np.concatenate([one, rng.normal(-3.0, 0.2, 1000)])
    assert len(Mixture.fitted(one, SETTINGS, 0).share) == 1
    mixture = Mixture.fitted(two, SETTINGS, 0)
    assert sorted(mixture.mean) == pytest.approx([-3.0, 2.0], abs=0.05)
    assert sorted(mixture.share) == pytest.approx([1 / 3, 2 / 3], abs=0.01)


def test_the_density_is_that_of_the_fit() -> None:
    values = np.concatenate([np.random.default_rng(2).normal(loc, 1.0, 500) for loc in (-4.0, 0.0, 5.0)])
    fitted = min(
        (GaussianMixture(k, random_state=3).fit(values[:, None]) for k in range(1, 6)),
        key=lambda mixture: mixture.bic(values[:, None]),
    )
    at = np.linspace(-8, 8, 41)
    assert Mixture.fitted(values, SETTINGS, 3).log_density(at) == pytest.approx(fitted.score_samples(at[:, None]))


@given(st.lists(number, min_size=3, max_size=3), number)
def test_the_odds_are_those_of_bayes_rule(seen: list[float], log_odds: float) -> None:
    shifted = [Mixture(share=(0.25, 0.75), mean=(k, -1.0), sd=(1.0 + k, 0.5)) for k in (0.0, 1.0, 2.0)]
    hypotheses = Hypotheses(log_odds=log_odds, begins=tuple(shifted), does_not=(NORMAL,) * 3)
    begins, does_not = np.exp(log_odds), 1.0
    for k, value in enumerate(seen):
        begins *= 0.25 * norm.pdf(value, k, 1.0 + k) + 0.75 * norm.pdf(value, -1.0, 0.5)
        does_not *= norm.pdf(value)
    expected = np.clip(np.log(begins / does_not), NEVER, -NEVER)
    assert hypotheses.after(np.array([seen]))[0] == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("positives", [0, 1])
def test_an_interval_in_which_hardly_a_change_begins_is_never_named(positives: int) -> None:
    """No event need begin within 0.5 to 1 s of a trained decision, as where each is watched from its onset on."""
    values = np.random.default_rng(4).normal(size=(50, 3))
    hypotheses = _hypotheses(values, np.arange(50) < positives, np.ones(50), SETTINGS, ("left_lane_change", 1, 0))
    assert (hypotheses.after(values) == NEVER).all()


def load(folder: Path) -> GaussianMixtures:
    return GaussianMixtures.load(folder, FitSettings(), SHAPE)


def stored(folder: Path) -> Path:
    facts = HazardFacts(
        horizons_s=(0.5, 2.0), learned=("left_lane_change",), passing=False, change_out="left_lane_change", uv=True,
        lanes=True, windows=WindowSettings(), decision_s=0.1, hours=1.0, events={},
    )  # fmt: skip
    hypotheses = Hypotheses(log_odds=-3.0, begins=(NORMAL,) * 3, does_not=(NORMAL,) * 3)
    fitted = FittedMixtures(intervals={"left_lane_change": (hypotheses, hypotheses)})
    GaussianMixtures(facts, SHAPE, fitted).save(folder)
    return folder / MIXTURES_FILE


@pytest.mark.parametrize(
    ("of_first", "message"),
    [
        ({"sd": [0.0]}, "above 0"),
        ({"mean": [0.0, 1.0]}, "not of one length"),
        ({"mean": [float("inf")]}, "finite|mean"),
    ],
)
def test_densities_that_are_none_are_refused(of_first: dict[str, list[float]], message: str, tmp_path: Path) -> None:
    path = stored(tmp_path)
    content = json.loads(path.read_text())
    content["intervals"]["left_lane_change"][0]["begins"][0] |= of_first
    path.write_text(json.dumps(content))
    with pytest.raises(InputError, match=message):
        load(tmp_path)


def test_mixtures_of_another_run_are_refused(tmp_path: Path) -> None:
    path = stored(tmp_path)
    content = path.read_text()
    assert load(tmp_path).fitted.intervals
    path.write_text(content.replace("left_lane_change", "right_lane_change"))
    with pytest.raises(ValueError, match="other changes of lane"):
        load(tmp_path)
    path.unlink()
    with pytest.raises(FileNotFoundError, match="is missing"):
        load(tmp_path)
