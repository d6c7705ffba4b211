"""`isac_cosim.evaluate`: a predictor of this tool, or any function of windows, measured as `cosim evaluate` does."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from isac_cosim.base.errors import InputError
from isac_cosim.classifier import IntentionClassifier
from isac_cosim.evaluation.on_windows.evaluation import evaluate as evaluate_run
from isac_cosim.evaluation.on_windows.results import EvaluationResult
from isac_cosim.evaluation.on_windows.settings import EvaluateSettings
from isac_cosim.labeling.dataset.dataset import Dataset
from isac_cosim.models.data.windows import Records
from isac_cosim.models.inference import Infer
from isac_cosim.models.predictors.protocol import Answer, AskedPredictor, Predictor
from isac_cosim.models.predictors.registry import ASKED
from isac_cosim.models.runs.run import Run, load_run
from isac_cosim.models.runs.settings import TrainSettings
from isac_cosim.models.training.training import run_in_memory

Asked = str | Path | Run | Infer | IntentionClassifier | Answer


def evaluate(
    asked: Asked,
    dataset: Dataset,
    out: str | Path | None = None,
    settings: EvaluateSettings | None = None,
    against: Sequence[str | Path | Run | Infer] = (),
    training: TrainSettings | None = None,
) -> EvaluationResult:
    """Do what `isac_cosim.evaluate` says."""
    run = _run_of(asked, dataset, training)
    others = [_trained(other) for other in against]
    return evaluate_run(run, dataset, out, settings, others).result


def _run_of(asked: Asked, dataset: Dataset, training: TrainSettings | None) -> Run:
    """Return the run to measure: a trained one, or one in memory around what was given."""
    if isinstance(asked, str | Path | Run | Infer):
        if training is not None:
            raise InputError("training: a trained predictor has its own settings; leave it out")
        return _trained(asked)
    predictor: Predictor
    if isinstance(asked, IntentionClassifier):
        if training is not None:
            raise InputError("training: a classifier has the settings of the windows it is fitted to; leave it out")
        predictor, training = asked.fitted
    else:
        name = str(getattr(asked, "__name__", type(asked).__name__))
        predictor = AskedPredictor(asked, name)
        training = TrainSettings.model_validate({**dict(training or TrainSettings()), "model": ASKED})
    made_of = {"digest": dataset.digest, "study": dataset.meta.study}
    return run_in_memory(predictor, Records.of(dataset), made_of, training, Path(predictor.display_name))


def _trained(asked: str | Path | Run | Infer) -> Run:
    if isinstance(asked, Infer):
        return asked.run
    return asked if isinstance(asked, Run) else load_run(asked)
