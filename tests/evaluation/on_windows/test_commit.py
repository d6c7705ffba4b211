"""Windows before and after the commit, and windows that end at a fixed time before it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from sklearn.metrics import f1_score, recall_score

from isac_cosim.evaluation.on_windows import commit
from isac_cosim.evaluation.on_windows.predictions import Predictions, ends_at_lead
from isac_cosim.evaluation.on_windows.score_results import BeforeCommit
from isac_cosim.labeling.intentions import Intention
from isac_cosim.models.data.windows import Records, WindowSettings
from isac_cosim.models.predictors.protocol import Outputs

CLASSES = tuple(intention.text for intention in Intention)[:6]


def drawn(n: int = 900, delay_s: float = 1.0) -> Predictions:
    """Windows of random intentions, ends and answers; the maneuvers commit `delay_s` after onset, swerves at once."""
    rng = np.random.default_rng(5)
    label = rng.integers(0, 7, n)
    after_onset_s = rng.uniform(-0.4, 2.0, n)
    delay = np.where(label == Intention.EVASIVE_SWERVE, 0.2, delay_s)
    logits = rng.normal(size=(n, 6))
    logits[np.arange(n), np.minimum(label, 5)] += 1.5
    return Predictions(
        outputs=Outputs(logits, logits),
        label=label,
        sample_id=np.array([f"toy-{k % 5}-{k}" for k in range(n)], dtype=object),
        group=np.array([f"toy-{k % 5}" for k in range(n)], dtype=object),
        end_s=100 + after_onset_s,
        lead_s=np.where(label == Intention.FOLLOWING, np.nan, delay - after_onset_s),
        snr_db=np.zeros(n),
        after_onset_s=after_onset_s,
        origin=rng.choice(["natural", "commanded"], n).astype(object),
        n_sites=np.full(n, 4),
        keeps_left=np.zeros(n, dtype=bool),
    )


@pytest.fixture(scope="module")
def scores() -> BeforeCommit:
    return commit.before_commit(drawn(), {0.5: drawn(200)}, CLASSES)


def test_before_and_after_the_commit_are_apart(scores: BeforeCommit) -> None:
    predictions = drawn()
    ends, lead = predictions.after_onset_s, predictions.lead_s
    known = predictions.label < 6
    before = known & (ends >= 0) & (lead > 0)
    label, predicted = predictions.label, predictions.predicted
    assert scores.n == before.sum()
    assert scores.groups == 5
    assert scores.accuracy == pytest.approx((label == predicted)[before].mean())
    assert scores.macro_f1 == pytest.approx(f1_score(label[before], predicted[before], average="macro"))
    recall = recall_score(label[before], predicted[before], average=None)
    assert [row.recall for row in scores.per_class.values()] == pytest.approx(list(recall))
    after = commit.after_commit(predictions, CLASSES)
    assert after.n == (known & (lead <= 0)).sum()
    # What ends before onset is neither.
    assert scores.n + after.n < known.sum()
    assert after.accuracy == pytest.approx((label == predicted)[known & (lead <= 0)].mean())


def test_natural_and_commanded_maneuvers_have_scores_of_their_own(scores: BeforeCommit) -> None:
    assert set(scores.by_origin) == {"natural", "commanded"}
    assert sum(part.n for part in scores.by_origin.values()) == scores.n
    at_lead = scores.by_lead[0]
    assert at_lead.lead_s == 0.5
    assert sum(part.n for part in at_lead.by_origin.values()) == at_lead.n == (drawn(200).label < 6).sum()


def test_a_rare_class_is_named_as_left_out_of_the_mean() -> None:
    predictions = drawn(40)
    scores = commit.before_commit(predictions, {}, CLASSES)
    enough = [name for name, row in scores.per_class.items() if row.n >= 5]
    assert scores.macro_f1_over == enough
    assert 0 < len(enough) < 6
    assert scores.macro_f1 == pytest.approx(np.mean([scores.per_class[name].f1 for name in enough]))


def test_a_class_that_commits_at_once_says_so(scores: BeforeCommit) -> None:
    delays = scores.onset_to_commit
    assert [name for name, delay in delays.items() if delay.at_once] == ["evasive_swerve"]
    assert delays["evasive_swerve"].median_s == pytest.approx(0.2)
    assert delays["overtake"].median_s == pytest.approx(1.0)
    assert sum(delay.n for delay in delays.values()) == (drawn().label < 6).sum()


def test_records_are_counted_once_whatever_their_windows() -> None:
    predictions = drawn(60)
    predictions.sample_id[:] = "toy-0-0"
    assert sum(delay.n for delay in commit.commit_delays(predictions, CLASSES).values()) <= 1


def test_five_classes_take_overtake_and_left_change_as_one() -> None:
    predictions = drawn()
    scores = commit.five_classes(predictions, CLASSES)
    known = predictions.label < 6
    joint = [np.where(x == Intention.OVERTAKE, Intention.LEFT_LANE_CHANGE, x)[known] for x in (
        predictions.label, predictions.predicted,
    )]  # fmt: skip
    assert len(scores.classes) == 5
    assert scores.n == known.sum()
    assert scores.accuracy == pytest.approx((joint[0] == joint[1]).mean())
    assert scores.macro_f1 == pytest.approx(f1_score(*joint, average="macro"))
    early = predictions.before_commit[known]
    assert scores.before_commit_macro_f1 == pytest.approx(f1_score(joint[0][early], joint[1][early], average="macro"))


LEFT, RIGHT = Intention.LEFT_LANE_CHANGE, Intention.RIGHT_LANE_CHANGE


def mirrored(predictions: Predictions, rows: np.ndarray) -> Predictions:
    """The same driving in the mirror, in some rows (n,): left is right there, and traffic keeps left."""
    label, logits = predictions.label.copy(), predictions.outputs.logits.copy()
    label[rows & (predictions.label == LEFT)] = RIGHT
    label[rows & (predictions.label == RIGHT)] = LEFT
    logits[np.ix_(rows, [LEFT, RIGHT])] = logits[np.ix_(rows, [RIGHT, LEFT])]
    return replace(predictions, label=label, outputs=Outputs(logits, logits), keeps_left=rows)


@pytest.mark.parametrize(
    ("share", "changes"),
    [
        (1.0, ("right_lane_change", "left_lane_change")),
        (0.4, ("lane_change_to_faster_side", "lane_change_to_slower_side")),
    ],
)
def test_an_overtake_begins_on_the_faster_side_where_traffic_keeps_left(share: float, changes: tuple[str, str]) -> None:
    predictions = drawn()
    mirror = mirrored(predictions, np.random.default_rng(2).uniform(size=len(predictions.label)) < share)
    five, in_mirror = (commit.five_classes(windows, CLASSES) for windows in (predictions, mirror))
    names = dict(zip(in_mirror.classes, five.classes, strict=True))
    assert names[f"{changes[0]}_or_overtake"] == "left_lane_change_or_overtake"
    assert names[changes[1]] == "right_lane_change"
    assert {names[name]: f1 for name, f1 in in_mirror.per_class_f1.items()} == five.per_class_f1
    assert (in_mirror.n, in_mirror.accuracy, in_mirror.macro_f1) == (five.n, five.accuracy, five.macro_f1)
    assert in_mirror.before_commit_macro_f1 == five.before_commit_macro_f1
    pair, pair_in_mirror = (commit.overtake_or_change(windows, CLASSES) for windows in (predictions, mirror))
    assert pair_in_mirror == pair.model_copy(update={"intentions": [changes[0], "overtake"]})


@pytest.mark.parametrize("lead_s", [0.25, 1.0, 1.5])
def test_ends_at_a_lead_lie_between_onset_and_commit(records: Records, lead_s: float) -> None:
    ends = ends_at_lead(records, WindowSettings(window_s=1.2), lead_s)
    table = records.table.iloc[ends.row]
    lead = table["t_commit"].to_numpy() - ends.times(records)
    np.testing.assert_allclose(lead, lead_s, atol=0.0051)
    assert (ends.times(records) >= table["t_onset"].to_numpy() - 1e-6).all()
    # Every record of a known intention that takes that long takes part, once.
    delay = (records.table["t_commit"] - records.table["t_onset"]).to_numpy()
    assert len(set(ends.row)) == len(ends)
    expected = np.flatnonzero((records.label < 6) & (delay > lead_s + 0.006))
    assert set(expected) <= set(ends.row) <= set(np.flatnonzero((records.label < 6) & (delay > lead_s - 0.006)))


def test_no_window_fits_a_lead_that_no_maneuver_takes(records: Records) -> None:
    assert len(ends_at_lead(records, WindowSettings(window_s=1.2), 2.1)) == 0
