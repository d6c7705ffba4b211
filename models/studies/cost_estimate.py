"""What a whole study will take, before any of it is done: datasets by their episodes, trainings by constants.

The constants are those of the predictors (`Predictor.cost_s`): processor time on one thread, measured on a machine that
was busy besides: of the default networks on windows of 2.2 s, 880 instants of the TV and 220 of the UV, in batches of
32; and of trees on 500 to 2,000 windows. Other widths cost otherwise, and a training that stops early takes less.
"""

from __future__ import annotations

from dataclasses import dataclass

from labeling.generation.cost_estimate import estimate, sensed_anew
from models.predictors.protocol import Workload
from models.predictors.registry import PREDICTORS
from models.studies.study import Study
from models.studies.sweep_axes import sensings

INSTANTS = 1100
"""Of a window of the measured kind, both streams together."""
RUN_BYTES, REPORT_BYTES = 12e6, 1.2e6
"""Of the folder of a trained network with its checkpoints, and of an evaluation's with its figures."""


@dataclass(frozen=True)
class StudyEstimate:
    """What a study will take.

    cells: of its table. trainings, datasets: how many. episodes, samples: that are generated. sensed_anew: samples.
    cpu_s, training_s: processor time of making the datasets, and of trainings and evaluations, s. bytes: on disk.
    """

    cells: int
    trainings: int
    datasets: int
    episodes: int
    samples: int
    sensed_anew: int
    cpu_s: float
    training_s: float
    bytes: int

    def seconds(self, workers: int) -> float:
        """Time on that many workers, s; one process trains."""
        return round(self.cpu_s / min(workers, max(1, self.episodes)) + self.training_s, 1)


def estimate_study(study: Study) -> StudyEstimate:
    """What a study will take, about; of what stands already nothing is subtracted."""
    made = {network: estimate(each) for network, each in study.networks.items()}
    ways = [each for each in sensings(study.axes) if each != study.first]
    anew = [sensed_anew(study.dataset, each, way.sensor) for each in made.values() for way in ways]
    datasets = [*made.values(), *anew]
    seeds = len(study.axes.training_seeds)
    trainings = len(study.cells) * seeds
    training = sum(seeds * cell_s(study, cell.model, made[cell.network].samples) for cell in study.cells)
    return StudyEstimate(
        cells=len(study.cells) if study.sweep else 1,
        trainings=trainings,
        datasets=len(datasets),
        episodes=sum(each.episodes for each in made.values()),
        samples=sum(each.samples for each in made.values()),
        sensed_anew=sum(each.samples for each in anew),
        cpu_s=round(sum(each.cpu_s for each in datasets), 1),
        training_s=round(training, 1),
        bytes=round(sum(each.bytes for each in datasets) + trainings * RUN_BYTES + len(study.cells) * REPORT_BYTES),
    )


def cell_s(study: Study, model: str, samples: int) -> float:
    """Processor time of one training of a cell and its evaluation, on a network of so many samples, s."""
    settings, evaluation, record = study.training.for_predictor(model), study.evaluation, study.dataset.record
    split, scale = settings.split, settings.windows.window_s * (record.tv_rate_hz + record.uv_rate_hz) / INSTANTS
    training = (1 - split.validation - split.test) * split.training_share * samples
    ends = evaluation.ends_per_record + (len(evaluation.sweep.ends_s) if evaluation.sweep else 0)
    tested = split.test * samples * ends * (1 + len(study.axes.test_on))
    return PREDICTORS[model].cost_s(Workload(training, split.validation * samples, tested, scale), settings)
