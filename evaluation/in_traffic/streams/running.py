"""Runs the missing episodes of an evaluation, with a progress bar, and collects the errors of workers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from isac_cosim.base.errors import RunError
from isac_cosim.base.feedback import Feedback
from isac_cosim.base.workers.engine import Engine

Item = TypeVar("Item")


@dataclass(frozen=True)
class Episodes(Generic[Item]):
    """The episodes of an evaluation.

    items: the argument of the task for each episode. finished: whether an episode needs no run. title, noun: shown in
    the progress bar and in the error; the noun is a plural. name: how the error names an episode.
    """

    items: Sequence[Item]
    finished: Callable[[Item], bool]
    title: str
    noun: str
    name: Callable[[Item], str]


def run_missing(
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
    done = len(episodes.items) - len(missing)
    lost: list[str] = []
    if not missing:
        return
    with feedback.bar(episodes.title, episodes.noun) as move:
        move(done, len(episodes.items))
        with closing(engine.run(task, missing)) as outcomes:
            for outcome in outcomes:
                if outcome.error is not None:
                    lost.append(f"{episodes.name(outcome.item)}: {outcome.error}")
                else:
                    keep(outcome.item, outcome.result)
                done += 1
                move(done, len(episodes.items))
    if lost:
        raise RunError(
            f"{len(lost)} of {len(episodes.items)} {episodes.noun} failed, {lost[0]}; the same command tries them again"
        )
