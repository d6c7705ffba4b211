"""The study of an evaluation, as the card of a run gives it."""

from __future__ import annotations

import pytest

from isac_cosim.base.errors import InputError
from isac_cosim.evaluation.in_traffic.measurement.evaluation import study_of
from isac_cosim.models.runs.run import Run


def test_alarms_are_never_chosen_on_measured_seeds(trees_run: Run) -> None:
    with pytest.raises(InputError, match="overlap"):
        study_of(trees_run.card, "road", (1, 4), (4, 6))


@pytest.mark.parametrize(
    ("uv_rate_hz", "decision_s", "report_delay_s"), [(100.0, 0.1, 0.02), (10.0, 0.1, 0.1), (25.0, 0.12, 0.04)]
)
def test_predictions_wait_for_whole_samples_of_the_run(
    trees_run: Run, uv_rate_hz: float, decision_s: float, report_delay_s: float
) -> None:
    card = trees_run.card.model_copy(update={"uv_rate_hz": uv_rate_hz})
    streams = study_of(card, "road").live.streams
    assert (streams.decision_s, streams.report_delay_s) == (decision_s, report_delay_s)


def test_the_evaluation_goes_by_the_dataset_of_the_run(trees_run: Run) -> None:
    study = study_of(trees_run.card, "ramp_weave", duration_s=30.0)
    assert study.dataset.sensing.channel.kind == "link"
    assert (study.dataset.traffic.duration_s, study.dataset.scenarios) == (30.0, ("ramp_weave",))
    slow = trees_run.card.model_copy(update={"tv_rate_hz": 200.0, "dataset": {"study": {"pairs": {"range_m": 50.0}}}})
    assert study_of(slow, "motorway").dataset.record.tv_rate_hz == 200.0
    assert study_of(slow, "motorway").dataset.pairs.range_m == 50.0
