"""Estimates what a whole study costs before it runs: datasets by their episodes, trainings by constants.

The constants are the predictors' own (`Predictor.cost_s`): processor time on one thread, measured on a machine with
other work to do: for the default networks on windows of 2.2 s, 880 instants of the TV and 220 of the UV, in batches of
32; and for trees on 500 to 2,000 windows. Networks of other widths cost more or less, and a training that stops early
costs less.
"""

from __future__ import annotations

from dataclasses import dataclass

from isac_cosim.labeling.generation.cost_estimate import estimate, sensed_anew
from isac_cosim.models.predictors.protocol import Workload
from isac_cosim.models.predictors.registry import PREDICTORS
from isac_cosim.studies.study import Study
from isac_cosim.studies.sweep_axes import sensings

INSTANTS = 1100
"""Instants of a window for which the constants hold, both streams together."""
RUN_BYTES, REPORT_BYTES = 12e6, 1.2e6
"""Size of the folder of a trained network with its checkpoints, and of an evaluation with its figures, bytes."""


@dataclass(frozen=True)
class StudyEstimate:
    """What a study costs.

    cells: number of cells in its table.
    trainings, datasets: number of each.
    episodes, samples: number that is generated.
    sensed_anew: number of samples that are sensed again.
    cpu_s: processor time of generating and sensing the datasets, s.
    training_s: processor time of trainings and evaluations, s.
    bytes: size on disk.
    threads: CPU threads of a training.
    most_at_once: number of trainings that may run at the same time.
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
    threads: int
    most_at_once: int

    def trainings_at_once(self, workers: int) -> int:
        """Return how many trainings run at the same time on that many workers."""
        return min(self.most_at_once, max(1, workers // self.threads))

    def generating_s(self, workers: int) -> float:
        """Return the time of the datasets on that many workers, s."""
        return self.cpu_s / min(workers, max(1, self.episodes))

    def seconds(self, workers: int) -> float:
        """Return the time on that many workers, s."""
        return round(self.generating_s(workers) + self.training_s / self.trainings_at_once(workers), 1)


def estimate_study(study: Study) -> StudyEstimate:
    """Return roughly what a study costs; results that exist already are not subtracted."""
    generated = {network: estimate(dataset) for network, dataset in study.networks.items()}
    others = [sensing for sensing in sensings(study.axes) if sensing != study.first]
    anew = [sensed_anew(study.dataset, cost, sensing.sensor) for cost in generated.values() for sensing in others]
    datasets = [*generated.values(), *anew]
    seeds = len(study.axes.training_seeds)
    trainings = len(study.cells) * seeds
    training = sum(seeds * cell_s(study, cell.model, generated[cell.network].samples) for cell in study.cells)
    return StudyEstimate(
        cells=len(study.cells) if study.sweep else 1,
        trainings=trainings,
        datasets=len(datasets),
        episodes=sum(cost.episodes for cost in generated.values()),
        samples=sum(cost.samples for cost in generated.values()),
        sensed_anew=sum(cost.samples for cost in anew),
        cpu_s=round(sum(cost.cpu_s for cost in datasets), 1),
        training_s=round(training, 1),
        bytes=round(sum(cost.bytes for cost in datasets) + trainings * RUN_BYTES + len(study.cells) * REPORT_BYTES),
        threads=study.training.optimiser.threads,
        most_at_once=trainings if study.sweep else 1,
    )


def cell_s(study: Study, model: str, samples: int) -> float:
    """Return the processor time of one training of a cell and its evaluation, s; samples: of its network's dataset."""
    settings, evaluation, record = study.training.for_predictor(model), study.evaluation, study.dataset.record
    split, scale = settings.split, settings.windows.window_s * (record.tv_rate_hz + record.uv_rate_hz) / INSTANTS
    training = (1 - split.validation - split.test) * split.training_share * samples
    ends = evaluation.ends_per_record + len(evaluation.leads_s)
    ends += len(evaluation.window_end_curve.ends_s) if evaluation.window_end_curve else 0
    tested = split.test * samples * ends * (1 + len(study.axes.test_on))
    return PREDICTORS[model].cost_s(Workload(training, split.validation * samples, tested, scale), settings)
