"""From hazards to log-odds, against probabilities multiplied out; what a predictor may not see, it does not use."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import expit, logit

from isac_cosim.base.arrays import Array
from isac_cosim.base.errors import InputError
from isac_cosim.labeling.intentions import KNOWN, Intention
from isac_cosim.models.data.windows import Windows, WindowSettings
from isac_cosim.models.hazards.answers import WITH_HAZARD
from isac_cosim.models.hazards.predictor import (
    NEVER,
    HazardFacts,
    HazardPredictor,
    Hazards,
    PlattScaling,
    both,
    within_horizons,
)
from isac_cosim.models.predictors.protocol import WindowShape

SHAPE = WindowShape(6, 880, 220, 400.0, 100.0)
LEFT = KNOWN.index(Intention.LEFT_LANE_CHANGE)
odds = st.floats(-12, 12)


@given(st.lists(odds, min_size=1, max_size=5))
def test_something_begins_within_a_horizon_unless_it_begins_in_no_interval(hazards: list[float]) -> None:
    within = within_horizons(np.array(hazards))
    for k in range(len(hazards)):
        none = np.prod(1 - expit(np.array(hazards[: k + 1])))
        assert expit(within[k]) == pytest.approx(1 - none, rel=1e-6, abs=1e-9)
    assert (np.diff(within) >= -1e-9).all()


@given(odds, odds)
def test_both_are_true_with_the_product_of_their_probabilities(first: float, second: float) -> None:
    assert expit(both(np.array(first), np.array(second))) == pytest.approx(
        expit(first) * expit(second), rel=1e-6, abs=1e-8
    )


class Fixed(HazardPredictor):
    """Answers every window with the same hazards."""

    display_name, summary = "fixed", "fixed"

    def __init__(self, facts: HazardFacts, intervals: Array, passing: float) -> None:
        super().__init__(facts, SHAPE)
        self.given = Hazards(intervals, np.full(len(intervals), passing))

    def hazards(self, windows: Windows) -> Hazards:
        return self.given

    fit_streams = save = load = None  # type: ignore[assignment]


Fixed.__abstractmethods__ = frozenset()


def facts(**given: object) -> HazardFacts:
    content = {
        "horizons_s": (0.5, 2.0), "learned": [intention.text for intention in WITH_HAZARD], "passing": True,
        "change_out": "left_lane_change", "uv": True, "lanes": False, "windows": WindowSettings(),
        "decision_s": 0.1, "hours": 1.0, "events": {},
    }  # fmt: skip
    return HazardFacts.model_validate(content | given)


WINDOWS = Windows(np.zeros((1, 6, 880), np.float32), np.zeros((1, 6, 220), np.float32))


def test_overtakes_are_pull_outs_that_pass() -> None:
    """The odds of a pull-out are shared between the overtake and the change of lane; together they are those again."""
    intervals = np.full((1, 5, 2), -1.0)
    answer = Fixed(facts(), intervals, 0.7)(WINDOWS).probabilities[0]
    pulls_out = 1 - (1 - expit(-1.0)) ** 2
    assert answer[KNOWN.index(Intention.OVERTAKE)] == pytest.approx(pulls_out * expit(0.7))
    assert answer[LEFT] == pytest.approx(pulls_out * expit(-0.7))
    assert answer[KNOWN.index(Intention.HARD_BRAKE)] == pytest.approx(pulls_out)


def test_what_was_not_learned_is_never_named() -> None:
    answer = Fixed(facts(learned=["hard_brake"]), np.full((1, 5, 2), 3.0), 0.0)(WINDOWS)
    others = [k for k, known in enumerate(KNOWN) if known is not Intention.HARD_BRAKE]
    assert answer.logits[0, others].max() <= NEVER
    assert answer.probabilities[0, KNOWN.index(Intention.HARD_BRAKE)] > 0.9


def test_calibration_scales_the_odds_of_its_intention_alone() -> None:
    intervals = np.full((1, 5, 2), -1.0)
    plain = Fixed(facts(), intervals, 0.0)(WINDOWS).logits[0]
    platt = {"hard_brake": PlattScaling(slope=2, offset=1)}
    scaled = Fixed(facts(calibration=platt), intervals, 0.0)(WINDOWS).logits[0]
    brake = KNOWN.index(Intention.HARD_BRAKE)
    assert scaled[brake] == pytest.approx(2 * plain[brake] + 1)
    assert np.delete(scaled, brake) == pytest.approx(np.delete(plain, brake))
    assert logit(expit(plain[brake])) == pytest.approx(plain[brake])


def test_without_the_lanes_that_it_needs_a_predictor_refuses() -> None:
    with pytest.raises(InputError, match="give the lanes"):
        Fixed(facts(lanes=True), np.zeros((1, 5, 2)), 0.0)(WINDOWS)


def test_facts_name_only_what_is_asked() -> None:
    for wrong in ({"learned": ["overtake"]}, {"change_out": "hard_brake"}, {"calibration": {"following": {}}}):
        with pytest.raises(ValueError, match="is not"):
            facts(**wrong)
