"""`DATASET/log.jsonl`: one line about every episode, in the order in which the episodes ended.

The log describes the commands that worked on a dataset. It is not part of the data: no digest covers it, and it may be
deleted.
"""

from __future__ import annotations

import errno
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Literal, Protocol

from pydantic import Field

from isac_cosim.base.errors import writing
from isac_cosim.base.feedback import Feedback
from isac_cosim.base.settings import Settings
from isac_cosim.base.workers.attempts import Outcome
from isac_cosim.isacsim.traffic.recordings.sumo_messages import SumoWarning
from isac_cosim.isacsim.traffic.recordings.traffic_facts import TrafficFacts
from isac_cosim.labeling.dataset.shard import Shard

LOG_FILE = "log.jsonl"
MOST_NAMED = 8
"""Parts of a scenario's files that one message names."""


class Entry(Settings):
    """What became of one episode.

    outcome: `made` if it has a shard, `lost` if it failed. seconds: duration of the last try, None if its worker died.
    retries: tries before the last one. events: number of events by intention. collided, teleported: number of vehicles,
    of the `vehicles` that departed. discarded: number of those that never could. beyond_car: number of vehicles that
    their driver model drove beyond 9 m/s2 or 25 m/s3. warnings: number of SUMO's warnings. sumo_warnings: the same by
    kind, each with an example. reason: why the episode was lost. printed: the end of what SUMO and other libraries
    printed.
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
    vehicles: int | None = None
    discarded: int = 0
    beyond_car: int = 0
    warnings: int = 0
    sumo_warnings: tuple[SumoWarning, ...] = ()
    reason: str | None = None
    printed: str = ""

    def __str__(self) -> str:
        outcome = f"{self.samples} samples" if self.outcome == "made" else f"lost, {self.reason}"
        duration = "" if self.seconds is None else f", {self.seconds:.1f} s"
        of_all = "" if self.vehicles is None else f" of {self.vehicles} vehicles"
        counts = {"retries": self.retries, "collided": self.collided, "discarded": self.discarded}
        counts["warnings"] = self.warnings
        incidents = "".join(
            f", {number}{of_all if name == 'collided' else ''} {name}" for name, number in counts.items() if number
        )
        return f"{self.scenario}-{self.seed}: {outcome}{duration}{incidents}"


Note = Callable[[Entry], None]
"""Called with the entry of every episode when it ends."""


def entry_of(shard: Shard, outcome: Outcome[Any, Any], traffic: TrafficFacts | None = None) -> Entry:
    """Return the entry of an episode that has a shard.

    outcome: of the task that wrote the shard. traffic: what became of the demand; None where that is not known.
    """
    episode = shard.episode
    known: dict[str, Any] = {}
    if traffic is not None:
        known = {"vehicles": traffic.vehicles, "discarded": traffic.discarded}
        known |= {"warnings": traffic.warning_count, "sumo_warnings": traffic.warnings}
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
        **known,
        printed=outcome.printed,
    )


def append(folder: Path, entry: Entry) -> None:
    """Add a line to a dataset's log. Raises OutputError if the log cannot be written, or is a link."""
    append_line(folder / LOG_FILE, entry.model_dump_json())


def append_line(path: Path, line: str) -> None:
    """Add a line to a file. An incomplete line of a killed command stays a line of its own.

    Raises OutputError if the file cannot be written, or is a link.
    """
    # A link could lead to a file that is not ours.
    with writing(path), open(path, "a+b", opener=_open_no_link) as file:
        if file.tell():
            file.seek(-1, 2)
            if file.read(1) != b"\n":
                file.write(b"\n")
        file.write(f"{line}\n".encode())


def record(folder: Path, feedback: Feedback, entry: Entry) -> None:
    """Add a line to a dataset's log, and report it as a detail."""
    append(folder, entry)
    feedback.detail(str(entry))


class Withheld(Protocol):
    """A scenario that SUMO does not get all of: options of its configuration, and parts of its files."""

    @property
    def overridden(self) -> Sequence[str]: ...

    @property
    def removed(self) -> Sequence[str]: ...


def withheld(name: str, scenario: Withheld) -> list[str]:
    """Return the messages about what SUMO does not get of a scenario, a line each."""
    lines = []
    if scenario.overridden:
        lines.append(
            f"{name}: these options of its configuration are not passed to SUMO: {', '.join(scenario.overridden)}"
        )
    if scenario.removed:
        more = len(scenario.removed) - MOST_NAMED
        named = ", ".join(scenario.removed[:MOST_NAMED]) + (f", and {more} more" if more > 0 else "")
        lines.append(f"{name}: left out, because it writes files or is in none of SUMO's schemas: {named}")
    return lines


def _open_no_link(path: str, flags: int) -> int:
    """Open a file unless it is a link. Raises OSError."""
    if os.path.islink(path):
        # Not every platform has the flag below, which leaves no moment between looking and opening.
        raise OSError(errno.ELOOP, os.strerror(errno.ELOOP), path)
    return os.open(path, flags | getattr(os, "O_NOFOLLOW", 0), 0o666)
