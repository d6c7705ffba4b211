"""The decisions of a dataset of streams that a predictor is trained on, as windows with their right answers."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from isac_cosim.base.arrays import Array, Float32Array, IntArray
from isac_cosim.base.errors import InputError
from isac_cosim.base.feedback import Feedback
from isac_cosim.base.seeding import stream
from isac_cosim.labeling.dataset.record_point import in_plane
from isac_cosim.labeling.intentions import Intention, outward
from isac_cosim.labeling.streams.dataset import Streams
from isac_cosim.labeling.streams.events import LiveEvent
from isac_cosim.labeling.streams.store import StoredStretch, StreamFacts
from isac_cosim.models.data.lane_map import LaneMap
from isac_cosim.models.data.windows import LaneMaps, OnMap, Windows, WindowSettings, in_frame
from isac_cosim.models.hazards.settings import StreamFitSettings
from isac_cosim.models.hazards.targets import Targets, counted_intentions, targets_of
from isac_cosim.models.predictors.protocol import WindowShape

BATCH = 256
"""Windows that are cut at a time."""


@dataclass(frozen=True)
class Decisions:
    """Some decisions: their windows, right answers, and weights, (n,): how many decisions each stands for."""

    windows: Windows
    targets: Targets
    weight: Array


@dataclass(frozen=True)
class StreamSide:
    """The episodes of a dataset of streams on one side of a split.

    episodes: `<scenario>-<seed>`. shape, windows: of the windows that are cut. seed: of what is drawn.
    """

    streams: Streams
    episodes: frozenset[str]
    settings: StreamFitSettings
    shape: WindowShape
    windows: WindowSettings
    seed: int

    @cached_property
    def lane_maps(self) -> LaneMaps:
        """The lanes of each scenario."""
        maps: dict[str, LaneMap] = {}

        def lane_map(scenario: str) -> LaneMap:
            if scenario not in maps:
                maps[scenario] = LaneMap.of(self.streams.roads(scenario))
            return maps[scenario]

        return lane_map

    @cached_property
    def facts(self) -> list[StreamFacts]:
        """The facts of the episodes."""
        return [facts for facts in self.streams.facts() if name_of(facts) in self.episodes]

    @property
    def hours(self) -> float:
        """Vehicle-hours."""
        return sum(facts.decisions * facts.decision_s for facts in self.facts) / 3600

    def events(self) -> Counter[Intention]:
        """Return the number of events of each intention, overtakes also among the changes of lane."""
        counts: Counter[Intention] = Counter()
        for facts in self.facts:
            change_out = outward(self.lane_maps(facts.scenario).lefthand)
            for event in facts.events:
                counts.update(counted_intentions(event, change_out))
        return counts

    def batches(self, moved: Callable[[int, int], None] = lambda done, total: None) -> Iterator[Decisions]:
        """Yield the decisions to train on, in order. moved: is told how many episodes are done, of how many."""
        for done, (facts, stretches) in enumerate(self.streams.read(self.episodes), start=1):
            of_vehicle = by_vehicle(facts.events)
            change_out = outward(self.lane_maps(facts.scenario).lefthand)
            for stretch in stretches:
                events = of_vehicle.get(stretch.tv_id, [])
                yield from self._of_stretch(facts, stretch, events, change_out)
            moved(done, len(self.episodes))

    def _of_stretch(
        self, facts: StreamFacts, stretch: StoredStretch, events: Sequence[LiveEvent], change_out: Intention
    ) -> Iterator[Decisions]:
        settings = self.settings
        targets = targets_of(events, stretch.decision_s, settings.horizons_s, change_out)
        rows, weight = self._chosen(facts, stretch, targets)
        for first in range(0, len(rows), BATCH):
            part = rows[first : first + BATCH]
            answers = Targets(targets.interval[part], targets.passing[part])
            yield Decisions(self._cut(facts, stretch, part), answers, weight[first : first + BATCH])

    def _chosen(self, facts: StreamFacts, stretch: StoredStretch, targets: Targets) -> tuple[IntArray, Array]:
        """Return the rows of the decisions to train on, and their weights, (m,) each.

        Every positive is taken; of the negatives, some shares, the hard ones rather than the others.
        """
        settings, times = self.settings, stretch.decision_s
        stride = max(1, round(settings.every_s / facts.decision_s))
        due = np.rint(times / facts.decision_s).astype(np.int64) % stride == 0
        positive = targets.positive(len(settings.horizons_s))
        hard = self._moves(facts.scenario, stretch)
        share = np.where(positive, 1.0, np.where(hard, settings.hard_share, settings.easy_share))
        key = (facts.scenario, facts.seed, stretch.tv_id, round(stretch.start_s * 1000))
        drawn = stream("decisions", self.seed, *key).random(len(times)) < share
        learnt = (targets.interval >= 0).any(axis=1)
        rows = np.flatnonzero(due & drawn & learnt)
        return rows, 1.0 / share[rows]

    def _moves(self, scenario: str, stretch: StoredStretch) -> Array:
        """Return at which decisions the TV moves across its lane, brakes or accelerates, (n,)."""
        at = np.rint((stretch.decision_s - stretch.start_s) * self.shape.tv_rate_hz).astype(np.int64)
        state = in_plane(self._states(stretch)[:, at], *stretch.point)
        heading = self.lane_maps(scenario).place(state[:2].T, state[2:4].T).heading
        across = heading[:, 0] * state[3] - heading[:, 1] * state[2]
        acceleration = np.hypot(state[4], state[5])
        return np.asarray(
            (np.abs(across) > self.settings.hard_across_mps) | (acceleration > self.settings.hard_acceleration_mps2)
        )

    def _states(self, stretch: StoredStretch) -> Float32Array:
        return stretch.tv_truth if self.settings.truth else stretch.tv

    def _cut(self, facts: StreamFacts, stretch: StoredStretch, rows: IntArray) -> Windows:
        shape = self.shape
        lengths, rates = (shape.tv_length, shape.uv_length), (shape.tv_rate_hz, shape.uv_rate_hz)
        delay_s = self.streams.meta.settings.stretches.report_delay_s
        pairs = [stretch.window(k, lengths, rates, delay_s, self.settings.truth) for k in rows.tolist()]
        tv, uv = (np.stack(part) for part in zip(*pairs, strict=True))
        windows = in_frame(tv, uv, self.windows, *rates)
        scenario = np.full(len(rows), facts.scenario, dtype=object)
        return replace(windows, on_map=OnMap(tv, uv, shape.tv_rate_hz, scenario, self.lane_maps))


def name_of(facts: StreamFacts) -> str:
    """Return `<scenario>-<seed>` of an episode."""
    return f"{facts.scenario}-{facts.seed}"


def by_vehicle(events: Sequence[LiveEvent]) -> dict[str, list[LiveEvent]]:
    """Return the events of each vehicle."""
    of_vehicle: dict[str, list[LiveEvent]] = defaultdict(list)
    for event in events:
        of_vehicle[event.vehicle].append(event)
    return of_vehicle


Features = Callable[[Windows], Array]
"""What a predictor computes of n windows, (n, F)."""


def gathered(
    side: StreamSide, features: Features, feedback: Feedback, title: str
) -> tuple[Float32Array, Targets, Array]:
    """Return features (n, F), right answers and weights (n,) of the decisions of a side."""
    parts: list[tuple[Float32Array, IntArray, IntArray, Array]] = []
    with feedback.bar(title, "episodes") as move:
        for batch in side.batches(move):
            values = features(batch.windows).astype(np.float32)
            parts.append((values, batch.targets.interval, batch.targets.passing, batch.weight))
    if not parts:
        raise InputError(f"{side.streams.path}: no decision to train on; generate more streams")
    values, interval, passing, weight = (np.concatenate(part) for part in zip(*parts, strict=True))
    return values, Targets(interval, passing), weight
