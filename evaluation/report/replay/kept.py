"""Keeps what a page shows in motion, so that the page can be made again without simulating."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import TypeVar

from pydantic import TypeAdapter

from isac_cosim.base.files import content_digest, replace_file
from isac_cosim.evaluation.closed_loop.store import ArmFacts
from isac_cosim.evaluation.in_traffic.streams.store import EpisodeFacts
from isac_cosim.evaluation.report.replay.again import Seen, Wanted
from isac_cosim.evaluation.report.replay.content import NEAR_M, RATE_HZ, STEP_S, Moving, Replay

MOMENTS_FILE = "moments.json"
"""In the folder of an evaluation: how the moments on its page move, by a digest of what that rests on."""
ADVISED_FILE = "advised.json"
"""In the folder of a closed loop: the moments with instructions, likewise."""
REPLAY_FILE = "replay.json"
"""Beside the page of a sweep: its whole replay."""
MOST_BYTES = 100_000_000
"""Largest size of each file."""
Kept = Mapping[str, list[Seen]]
"""How the wanted TVs of episodes move, by the digest of each episode (`digest_of`)."""
KeptAdvised = Mapping[str, list[Moving]]
"""The moments with instructions in an arm, by the digest of the arm and of how many there are at most."""
_CONTENT = TypeAdapter(Kept)
_ADVISED = TypeAdapter(KeptAdvised)
_REPLAY = TypeAdapter(Replay)
Content = TypeVar("Content")


def digest_of(facts: EpisodeFacts, wanted: Sequence[Wanted]) -> str:
    """Return a digest of all that the motion of an episode's wanted TVs rests on.

    The episode's fingerprint stands for the study, the scenario's files, the run and the versions of the packages.
    """
    tvs = [{**asdict(one), "decided_s": one.decided_s.tolist()} for one in wanted]
    return content_digest([facts.model_dump(mode="json"), tvs, RATE_HZ, STEP_S, NEAR_M])


def read_kept(folder: Path | None) -> Kept:
    """Return what a folder keeps; nothing where there is no such file, or a damaged one."""
    return (None if folder is None else _read(folder / MOMENTS_FILE, _CONTENT)) or {}


def _read(path: Path, adapter: TypeAdapter[Content]) -> Content | None:
    with suppress(OSError, ValueError):
        if path.stat().st_size <= MOST_BYTES:
            return adapter.validate_json(path.read_bytes())
    return None


def write_kept(folder: Path, kept: Kept) -> None:
    """Keep how the TVs of episodes move. Raises OutputError."""
    replace_file(folder / MOMENTS_FILE, lambda partial: partial.write_bytes(_CONTENT.dump_json(kept)))


def digest_of_arm(facts: ArmFacts, most: int) -> str:
    """Return a digest of all that the moments of an arm rest on. most: moments."""
    return content_digest([facts.model_dump(mode="json"), most, RATE_HZ, STEP_S, NEAR_M])


def read_advised(folder: Path) -> KeptAdvised:
    """Return the moments with instructions that a folder keeps; nothing without such a file, or from a damaged one."""
    return _read(folder / ADVISED_FILE, _ADVISED) or {}


def write_advised(folder: Path, kept: KeptAdvised) -> None:
    """Keep the moments with instructions of arms. Raises OutputError."""
    replace_file(folder / ADVISED_FILE, lambda partial: partial.write_bytes(_ADVISED.dump_json(kept)))


def read_replay(folder: Path) -> Replay | None:
    """Return the replay that a folder keeps; None without such a file, or from a damaged one."""
    return _read(folder / REPLAY_FILE, _REPLAY)


def write_replay(folder: Path, replay: Replay) -> None:
    """Keep a replay. Raises OutputError."""
    replace_file(folder / REPLAY_FILE, lambda partial: partial.write_bytes(_REPLAY.dump_json(replay)))
