"""Runs the missing episodes of a folder, and collects the errors of workers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic

from isac_cosim.base.errors import RunError
from isac_cosim.base.feedback import Feedback
from isac_cosim.base.files import remove_partial, write_json
from isac_cosim.base.settings import Settings
from isac_cosim.base.workers.attempts import Item, Outcome
from isac_cosim.base.workers.engine import Engine
from isac_cosim.base.workers.missing import Tally, run_missing


@dataclass(frozen=True)
class Episodes(Generic[Item]):
    """The episodes of a folder.

    items: the argument of the task for each episode. finished: whether an episode needs no run. title, noun: shown in
    the progress bar and in the error; the noun is a plural. name: how the error names an episode. advice: how to get
    past an episode that fails every time.
    """

    items: Sequence[Item]
    finished: Callable[[Item], bool]
    title: str
    noun: str
    name: Callable[[Item], str]
    advice: str = ""


def begin_episodes(file: Path, begun: Settings, folder: Path) -> None:
    """Write the file that says what is evaluated, and prepare the folder of its episodes. Raises OutputError."""
    write_json(file, begun.model_dump(mode="json"))
    folder.mkdir(exist_ok=True)
    remove_partial(folder, "*.parquet")


def run_episodes(
    task: Callable[[Item], Any],
    episodes: Episodes[Item],
    engine: Engine,
    feedback: Feedback,
    keep: Callable[[Item, Any], None] = lambda item, result: None,
) -> None:
    """Run the episodes that are not finished.

    keep: called with each episode and the task's result.
    Raises RunError after all episodes were run, if some failed; what the engine raises, at once.
    """
    missing = [item for item in episodes.items if not episodes.finished(item)]
    tally = Tally(len(episodes.items), len(episodes.items) - len(missing))
    lost: list[str] = []
    if not missing:
        return

    def finish(outcome: Outcome[Item, Any]) -> None:
        if outcome.error is not None:
            lost.append(f"{episodes.name(outcome.item)}: {outcome.error}")
        else:
            keep(outcome.item, outcome.result)
        tally.done += 1

    run_missing(task, missing, engine, feedback, title=episodes.title, unit=episodes.noun, keep=finish, progress=tally)
    if lost:
        raise RunError(
            f"{len(lost)} of {len(episodes.items)} {episodes.noun} failed, {lost[0]}; the same command tries them "
            f"again{episodes.advice}"
        )
