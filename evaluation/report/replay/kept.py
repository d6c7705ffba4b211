"""Keeps how the moments of an evaluation in traffic move, so that its page can be made again without simulating."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path

from pydantic import TypeAdapter

from isac_cosim.base.files import content_digest, replace_file
from isac_cosim.evaluation.in_traffic.streams.store import EpisodeFacts
from isac_cosim.evaluation.report.replay.again import Seen, Wanted
from isac_cosim.evaluation.report.replay.content import NEAR_M, RATE_HZ, STEP_S

MOMENTS_FILE = "moments.json"
"""In the folder of an evaluation: how the moments on its page move, by a digest of what that rests on."""
MOST_BYTES = 100_000_000
"""Largest size of MOMENTS_FILE."""
Kept = Mapping[str, list[Seen]]
"""How the wanted TVs of episodes move, by the digest of each episode (`digest_of`)."""
_CONTENT = TypeAdapter(Kept)


def digest_of(facts: EpisodeFacts, wanted: Sequence[Wanted]) -> str:
    """Return a digest of all that the motion of an episode's wanted TVs rests on.

    The episode's fingerprint stands for the study, the scenario's files, the run and the versions of the packages.
    """
    tvs = [{**asdict(one), "decided_s": one.decided_s.tolist()} for one in wanted]
    return content_digest([facts.model_dump(mode="json"), tvs, RATE_HZ, STEP_S, NEAR_M])


def read_kept(folder: Path | None) -> Kept:
    """Return what a folder keeps; nothing where there is no such file, or a damaged one."""
    with suppress(OSError, ValueError):
        if folder is not None and (path := folder / MOMENTS_FILE).stat().st_size <= MOST_BYTES:
            return _CONTENT.validate_json(path.read_bytes())
    return {}


def write_kept(folder: Path, kept: Kept) -> None:
    """Keep how the TVs of episodes move. Raises OutputError."""
    replace_file(folder / MOMENTS_FILE, lambda partial: partial.write_bytes(_CONTENT.dump_json(kept)))
