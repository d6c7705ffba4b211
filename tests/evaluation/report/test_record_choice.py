"""The record that the report draws: a typical one among those that were recognised, by the rule that it states."""

import numpy as np

from isac_cosim.evaluation.on_windows.predictions import Predictions
from isac_cosim.evaluation.report.record_view import choose_record
from isac_cosim.labeling.intentions import Intention
from isac_cosim.models.predictors.protocol import Outputs

LEFT, RIGHT, BRAKE, FOLLOWING = (
    Intention.LEFT_LANE_CHANGE, Intention.RIGHT_LANE_CHANGE, Intention.HARD_BRAKE, Intention.FOLLOWING,
)  # fmt: skip
Window = tuple[str, Intention, float, Intention, float]
"""sample_id, true intention, end, predicted intention, and its probability."""


def predictions_of(windows: list[Window], left_out: Intention | None = None) -> Predictions:
    probabilities = np.zeros((len(windows), 6))
    for row, (_, _, _, predicted, probability) in enumerate(windows):
        probabilities[row] = (1 - probability) / 5
        probabilities[row, predicted] = probability
    ids, labels, ends = (np.array([window[k] for window in windows], dtype=object) for k in range(3))
    return Predictions(
        outputs=Outputs(np.log(probabilities), np.zeros((len(windows), 1))),
        label=labels.astype(np.int64),
        sample_id=ids,
        group=np.full(len(windows), "toy-0", dtype=object),
        end_s=ends.astype(float),
        lead_s=-ends.astype(float),
        snr_db=np.zeros(len(windows)),
        after_onset_s=ends.astype(float),
        origin=np.full(len(windows), "natural", dtype=object),
        n_sites=np.full(len(windows), 4),
        keeps_left=np.zeros(len(windows), dtype=bool),
        left_out=left_out,
    )


def test_the_record_of_median_confidence_is_chosen_not_the_best() -> None:
    choice = choose_record(
        predictions_of(
            [
                ("best", LEFT, 2.0, LEFT, 0.99),
                ("worst", LEFT, 2.0, LEFT, 0.5),
                ("wrong", LEFT, 2.0, RIGHT, 0.7),
                ("median", LEFT, 2.0, LEFT, 0.8),
                ("other", RIGHT, 2.0, RIGHT, 0.8),
            ]
        )
    )
    assert choice.sample_id == "median"
    assert choice.rule.startswith("Of 4 test records of left lane change, 3 were recognised")
    assert "median probability" in choice.rule


def test_the_last_window_of_a_record_decides_whatever_its_place() -> None:
    choice = choose_record(
        predictions_of(
            [
                ("late right", LEFT, 2.0, LEFT, 0.6),
                ("late right", LEFT, 1.0, BRAKE, 0.9),
                ("late wrong", LEFT, 1.0, LEFT, 0.6),
                ("late wrong", LEFT, 2.0, BRAKE, 0.9),
            ]
        )
    )
    assert choice.sample_id == "late right"
    assert choice.rule.startswith("Of 2 test records of left lane change, 1 was recognised")


def test_of_an_even_number_the_less_confident_of_the_middle_two_is_chosen() -> None:
    windows: list[Window] = [(str(k), LEFT, 2.0, LEFT, 0.5 + k / 10) for k in (3, 1, 0, 2)]
    assert choose_record(predictions_of(windows)).sample_id == "1"


def test_an_intention_that_was_never_recognised_gives_way_to_the_next() -> None:
    windows: list[Window] = [("left", LEFT, 2.0, BRAKE, 0.9), ("brake", BRAKE, 2.0, BRAKE, 0.9)]
    assert choose_record(predictions_of(windows)).sample_id == "brake"


def test_without_any_recognised_record_the_caption_says_so() -> None:
    windows: list[Window] = [("left", LEFT, 2.0, BRAKE, 0.9), ("following", FOLLOWING, 2.0, LEFT, 0.9)]
    choice = choose_record(predictions_of(windows))
    assert choice.sample_id == "left"
    assert choice.rule.startswith("None of the 1 test records was recognised")


def test_an_intention_held_out_is_not_drawn_as_recognised() -> None:
    windows: list[Window] = [("left", LEFT, 2.0, RIGHT, 0.9), ("right", RIGHT, 2.0, RIGHT, 0.9)]
    assert choose_record(predictions_of(windows, left_out=LEFT)).sample_id == "right"
    assert "none is of an intention that was trained" in choose_record(predictions_of(windows[:1], LEFT)).rule
