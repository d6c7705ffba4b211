"""The stimulated world beside natural traffic: the same questions on the same seeds, as a stress test.

DIR/stress/           an evaluation of its own, as `evaluation.in_traffic.measurement.evaluation` describes it
DIR/metrics.json      the natural result, with the scores of the stimulated world under `stress`
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from isac_cosim.base.feedback import SILENT, Feedback
from isac_cosim.base.files import write_json
from isac_cosim.base.workers.engine import Engine
from isac_cosim.evaluation.in_traffic.measurement.evaluation import evaluate_traffic
from isac_cosim.evaluation.in_traffic.measurement.summary import TrafficEvaluation
from isac_cosim.evaluation.in_traffic.scores.results import METRICS_FILE, StressResult
from isac_cosim.evaluation.in_traffic.settings import LiveStudy
from isac_cosim.isacsim.traffic.sources.protocol import MotionSource
from isac_cosim.models.runs.run import Run

STRESS = "stress"
"""In the folder of an evaluation: that of the stimulated world."""


def with_stress(
    natural: TrafficEvaluation,
    run: Run,
    study: LiveStudy,
    out: Path,
    engine: Engine | None = None,
    feedback: Feedback = SILENT,
    against: Sequence[Run] = (),
    source: MotionSource | None = None,
) -> TrafficEvaluation:
    """Evaluate a run in the stimulated world, too, and add that to the result of natural traffic and to its file.

    study: of the stimulated world. out: folder of the natural evaluation. Other arguments and errors as in
    `evaluate_traffic`.
    """
    stressed = evaluate_traffic(run, study, out / STRESS, engine, feedback, against, source).result
    stress = StressResult(
        vehicle_hours=stressed.vehicle_hours,
        prediction=stressed.prediction,
        recognition=stressed.recognition,
        compared=stressed.compared,
    )
    result = natural.result.model_copy(update={"stress": stress})
    write_json(out / METRICS_FILE, result.model_dump(mode="json"))
    return replace(natural, result=result)
