"""An overtake and an evasive swerve of a study's test seeds, in motion.

    python -m isac_cosim.benchmarks.findings.moving_road STUDY ANIMATION

STUDY: folder of a finished `cosim run`, with `run` and `dataset` in it. ANIMATION: ends in .webp or .gif. Each is the
first one of the test seeds, rightly answered or not. Episodes are simulated again for the other vehicles.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

from isac_cosim.base.arrays import Array
from isac_cosim.base.errors import InputError
from isac_cosim.base.workers.engine import LocalEngine
from isac_cosim.evaluation.report.replay.content import Moving, Replay
from isac_cosim.evaluation.report.replay.making import replay_of
from isac_cosim.evaluation.report.roads.animation import animate
from isac_cosim.labeling.dataset.dataset import Dataset
from isac_cosim.labeling.dataset.finding import find_episode
from isac_cosim.models.runs.run import Run, load_run

SHOWN = ("overtake", "evasive_swerve")


def first_of_each(dataset: Dataset, run: Run) -> Replay:
    """Return a replay of the first record of each intention in `SHOWN` in a run's test seeds.

    Raises InputError where there is none of an intention.
    """
    found = dict[str, Moving]()
    lanes = dict[tuple[float, bytes], tuple[float, Array]]()
    sites = dict[str, tuple[str, float, float, float]]()
    for name in run.card.split["test"]:
        replay = replay_of(dataset, find_episode(dataset, name), LocalEngine(1), run)
        for record in replay.records:
            if record.intention in SHOWN:
                found.setdefault(record.intention, record)
        lanes |= {(width, line.tobytes()): (width, line) for width, line in replay.lanes}
        sites |= {site[0]: site for site in replay.sites}
        if len(found) == len(SHOWN):
            shown = [found[intention] for intention in SHOWN]
            return replace(replay, records=shown, lanes=[*lanes.values()], sites=[*sites.values()])
    missing = ", ".join(intention for intention in SHOWN if intention not in found)
    raise InputError(f"{dataset.path}: the test seeds hold no {missing}; generate more seeds")


def main(study: str, animation: str) -> None:
    """Write the animation, and say what is on it."""
    replay = first_of_each(Dataset.open(Path(study) / "dataset"), load_run(Path(study) / "run"))
    frames = animate(replay, replay.records, Path(animation))
    for record in replay.records:
        right = record.answers is not None and record.answers.wrong is False
        print(f"{record.intention}: {record.id} ({record.origin}), {'rightly' if right else 'not rightly'} answered")
    print(f"{animation}: {frames} frames, {Path(animation).stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit("usage: python -m isac_cosim.benchmarks.findings.moving_road STUDY ANIMATION")
    try:
        main(*sys.argv[1:])
    except InputError as error:
        sys.exit(str(error))
