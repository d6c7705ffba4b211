"""Which candidates of an episode become samples: an even draw from each class, until it has as many as it may.

Whether enough sites see a candidate shows only when it is sensed. Where they do not, the next one that was drawn takes
its place.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

from isac_cosim.base.seeding import stream
from isac_cosim.labeling.generation.settings import SelectionSettings
from isac_cosim.labeling.intentions import Intention
from isac_cosim.labeling.samples.candidates import Candidate

Made = TypeVar("Made")
"""What is made of a candidate."""


@dataclass(frozen=True)
class Draw:
    """Candidates in the order in which they are drawn, and how many of them may become samples."""

    candidates: tuple[Candidate, ...]
    limit: int


@dataclass(frozen=True)
class Selection(Generic[Made]):
    """The candidates that become samples, in the order of onset, each with what is made of it.

    unseen: number of those that were drawn, and of which nothing could be made. surplus: number of those that were not
    drawn, because the limits were reached before.
    """

    made: list[tuple[Candidate, Made]]
    unseen: int
    surplus: int


def draws(available: Sequence[Candidate], settings: SelectionSettings, key: tuple[str, int]) -> list[Draw]:
    """Draw the candidates of each intention. key: scenario and seed, which name the draws."""
    of_each = []
    for intention in Intention:
        of_class = [candidate for candidate in available if candidate.intention is intention]
        limit = settings.following if intention is Intention.FOLLOWING else settings.per_class
        of_each.append(_drawn(of_class, limit, intention.text, key))
    return of_each


def draw_of_pull_outs(dropped: Sequence[Candidate], settings: SelectionSettings, key: tuple[str, int]) -> Draw:
    """Draw dropped pull-outs. key: scenario and seed, which name the draw."""
    return _drawn(dropped, settings.pull_outs, "dropped pull-outs", key)


def _drawn(candidates: Sequence[Candidate], limit: int, name: str, key: tuple[str, int]) -> Draw:
    order = stream("selection", *key, name).permutation(len(candidates))
    return Draw(tuple(candidates[k] for k in order.tolist()), limit)


def select(drawn: Sequence[Draw], make: Callable[[Sequence[Candidate]], Sequence[Made | None]]) -> Selection[Made]:
    """Choose candidates in their drawn order, up to the limit of each draw.

    make: returns what is made of each of some candidates, None where nothing can be. It is asked for as many as are
    still missing, until they are complete or no candidate is left.
    """
    asked, made = [0] * len(drawn), [list[tuple[Candidate, Made]]() for _ in drawn]
    while True:
        wanted = [
            (k, candidate)
            for k, draw in enumerate(drawn)
            for candidate in draw.candidates[asked[k] : asked[k] + max(draw.limit - len(made[k]), 0)]
        ]
        if not wanted:
            break
        wanted.sort(key=lambda item: _by_onset(item[1]))
        for (k, candidate), item in zip(wanted, make([candidate for _, candidate in wanted]), strict=True):
            asked[k] += 1
            if item is not None:
                made[k].append((candidate, item))
    all_made = sorted((pair for of_draw in made for pair in of_draw), key=lambda pair: _by_onset(pair[0]))
    total = sum(len(draw.candidates) for draw in drawn)
    return Selection(all_made, sum(asked) - len(all_made), total - sum(asked))


def _by_onset(candidate: Candidate) -> tuple[float, str, Intention]:
    return candidate.t_onset, candidate.tv, candidate.intention
