"""The figure of docs/live.md, from what `cosim evaluate RUN --traffic SCENARIO` measured.

    python docs/live_figure.py METRICS.json [FURTHER.json ...] docs/images/live_recall.png

Draws the recall of alarms that were chosen on the development seeds for each rate of false alarms and then frozen,
against the rate that they had on the measured seeds.
"""

from __future__ import annotations

import runpy
import sys
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from isac_cosim.evaluation.in_traffic.scores.results import AlarmResult
from isac_cosim.evaluation.report.figures import BESIDE, BY_PREDICTOR, figure


def draw(predictors: Mapping[str, AlarmResult], path: Path) -> None:
    """Draw a line for each predictor, with the 95 % intervals of recall over the measured seeds."""
    with figure(path, 8, 4.4) as drawn:
        axes = drawn.subplots()
        axes.set_prop_cycle(BY_PREDICTOR)
        for name, alarms in predictors.items():
            points = [
                (point.measured, point.recall, point.recall_interval.low, point.recall_interval.high)
                for point in alarms.frozen_at["separate"]
                if point.measured and point.keeps_to_rate and point.recall is not None and point.recall_interval
            ]
            rate, recall, low, high = np.array(points).T
            axes.errorbar(rate, recall, [recall - low, high - recall], fmt="o-", capsize=2, label=name)
        axes.set(xscale="log", xlim=(0.05, 20), ylim=(0, None))
        axes.set(xlabel="false alarms per vehicle-hour", ylabel="recall: share of events predicted by their commit")
        axes.set_title("Alarms frozen for 0.1, 0.3, 1, 3 and 10 false alarms per vehicle-hour")
        axes.legend(**BESIDE)


def main() -> None:
    """Draw the results that the command line names into the file that it names last."""
    tables = runpy.run_path(str(Path(__file__).with_name("live_tables.py")))
    first, *further = map(Path, sys.argv[1:-1])
    read = tables["read_result"]
    predictors = tables["of_five"](read(first), [read(path) for path in further if path.is_file()])
    draw({name: trainings[0] for name, trainings in predictors.items()}, Path(sys.argv[-1]))


if __name__ == "__main__":
    main()
