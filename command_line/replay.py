"""`replay`: the page with the road that moves, of an episode of a dataset."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rich.console import Console

from isac_cosim.base.errors import InputError
from isac_cosim.base.files import json_text
from isac_cosim.base.progress import print_line
from isac_cosim.command_line import output

BESIDE = "dataset"
"""Where a study keeps the dataset of its run: in a folder of this name beside the run's."""


def replay_and_show(source: Path, data: Path | None, episode: str, page: Path, console: Console) -> dict[str, Any]:
    """Write the page of an episode, and say what is on it. Returns what `--json` prints.

    source: a run or a dataset. data: dataset of a run; by default the one that it was trained on, where it lies beside
    the run. Raises InputError for other folders.
    """
    from isac_cosim.base.workers.engine import LocalEngine
    from isac_cosim.evaluation.report.page import check_page, write_content
    from isac_cosim.evaluation.report.parts import Part
    from isac_cosim.evaluation.report.replay.making import replay_of
    from isac_cosim.labeling.dataset.dataset import META_FILE, Dataset
    from isac_cosim.labeling.dataset.finding import find_episode
    from isac_cosim.models.runs.run import CARD_FILE, load_run

    check_page(page)
    if (source / CARD_FILE).is_file():
        run = load_run(source)
        dataset = Dataset.open(data or source.absolute().parent / BESIDE) if data or _beside(source) else None
        if dataset is None:
            raise InputError(f"{source}: is a run; give the dataset whose episode is to be shown with --data")
        if data is None and dataset.digest != run.card.dataset["digest"]:
            raise InputError(f"{dataset.path}: is not the dataset that {source} was trained on; give one with --data")
    elif (source / META_FILE).is_file():
        if data is not None:
            raise InputError(f"--data gives the dataset of a run, and {source} is a dataset itself; leave it out")
        run, dataset = None, Dataset.open(source)
    else:
        raise InputError(f"{source}: is neither a run (no {CARD_FILE}) nor a dataset (no {META_FILE})")
    shard = find_episode(dataset, episode)
    replay = replay_of(dataset, shard, LocalEngine(1), run, output.feedback_of(console))
    origin = {"dataset": dataset.digest, "run": None if run is None else run.card.files, "episode": episode}
    write_content(page, replay.title, [Part("replay", replay=replay)], json_text(origin, 1), page.parent)
    for remark in replay.remarks:
        print_line(console, remark)
    wrong = [record.id for record in replay.records if record.answers is not None and record.answers.wrong]
    print_line(console, f"{len(replay.records)} records to replay: {page}")
    others = any(record.others for record in replay.records)
    return {"page": str(page), "records": len(replay.records), "wrong": wrong, "others": others}


def _beside(run: Path) -> bool:
    from isac_cosim.labeling.dataset.dataset import META_FILE

    return (run.absolute().parent / BESIDE / META_FILE).is_file()
