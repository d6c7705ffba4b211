"""`DATASET/log.jsonl`: what became of every episode, a line each, in the order in which they ended.

The log is of the runs that made a dataset, not of the dataset: no digest covers it, and it may be deleted.
"""

from __future__ import annotations

import errno
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Literal

from pydantic import Field

from isacsim.errors import writing
from isacsim.feedback import Feedback
from isacsim.settings import Settings
from labeling.dataset.shard import Shard
from labeling.generation.engine import Outcome

LOG_FILE = "log.jsonl"


class Entry(Settings):
    """One episode as it ended.

    seconds: that its last try took, None where its worker died. retries: tries before that. events: found, by
    intention. collided, teleported: vehicles. beyond_car: those that their driver model drove beyond 9 m/s2 or 25 m/s3.
    warnings: SUMO's. reason: why it was lost.
    """

    scenario: str
    seed: int
    outcome: Literal["made", "lost"]
    samples: int = 0
    seconds: float | None = None
    retries: int = 0
    events: dict[str, int] = Field(default_factory=dict)
    collided: int = 0
    teleported: int = 0
    beyond_car: int = 0
    warnings: int = 0
    reason: str | None = None

    def __str__(self) -> str:
        what = f"{self.samples} samples" if self.outcome == "made" else f"lost, {self.reason}"
        took = "" if self.seconds is None else f", {self.seconds:.1f} s"
        rest = {"retries": self.retries, "collided": self.collided, "warnings": self.warnings}
        more = "".join(f", {number} {name}" for name, number in rest.items() if number)
        return f"{self.scenario}-{self.seed}: {what}{took}{more}"


Note = Callable[[Entry], None]
"""Is given every episode as it ends."""


def made(shard: Shard, outcome: Outcome[Any, Any], warnings: int = 0) -> Entry:
    """The entry of an episode whose shard stands."""
    episode = shard.episode
    return Entry(
        scenario=episode.scenario,
        seed=episode.seed,
        outcome="made",
        samples=shard.samples,
        seconds=outcome.seconds,
        retries=outcome.retries,
        events=episode.events,
        collided=episode.collided,
        teleported=episode.teleported,
        beyond_car=episode.counts.get("beyond_car", 0),
        warnings=warnings,
    )


def append(folder: Path, entry: Entry) -> None:
    """Add a line to a dataset's log. What a killed command left of a line stays a line of its own."""
    path = folder / LOG_FILE
    # A link, which would lead to a file that is no log, is not followed.
    with writing(path), open(path, "a+b", opener=_open_no_link) as file:
        if file.tell():
            file.seek(-1, 2)
            if file.read(1) != b"\n":
                file.write(b"\n")
        file.write(f"{entry.model_dump_json()}\n".encode())


def record(folder: Path, feedback: Feedback, entry: Entry) -> None:
    """Add a line to a dataset's log, and report it as a detail."""
    append(folder, entry)
    feedback.detail(str(entry))


def overridden(scenario: str, options: Sequence[str]) -> str:
    """The message about options of a scenario's configuration that are not followed."""
    return f"{scenario}: the time base and outputs are fixed; these options are ignored: {', '.join(options)}"


def _open_no_link(path: str, flags: int) -> int:
    """Open a file unless it is a link. Raises OSError."""
    if os.path.islink(path):
        # Not every platform has the flag below, which leaves no moment between looking and opening.
        raise OSError(errno.ELOOP, os.strerror(errno.ELOOP), path)
    return os.open(path, flags | getattr(os, "O_NOFOLLOW", 0), 0o666)
