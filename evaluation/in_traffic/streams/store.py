"""One episode of an evaluation in traffic on disk: every answer to every watched vehicle, and the events."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.parquet as pq
from pydantic import Field

from isac_cosim.base.arrays import Array, Float32Array, IntArray
from isac_cosim.base.settings import Settings
from isac_cosim.base.stored.episode_files import EpisodeFiles, named_column, names_and_numbers
from isac_cosim.base.stored.tables import check_types
from isac_cosim.evaluation.in_traffic.streams.predictions import Answers
from isac_cosim.labeling.intentions import KNOWN
from isac_cosim.labeling.streams.events import GROUPS, NEAR_MISS, LiveEvent

EPISODES, SPEED_FILE = "episodes", "speed.json"
"""In the folder of an evaluation: the folder of the episodes, and the file with the processor time of each."""
ROW_GROUP = 8192
RUN = "run"
"""The name of the evaluated run among the predictors of an episode."""
RULE = "rule"
"""The name of the rule of the road."""
TRUTH = "truth"
"""The name of the evaluated run where it answers the true motion of the TV."""
COLUMNS = pa.schema([("tv", pa.dictionary(pa.int32(), pa.string())), ("time_s", pa.float64()), ("group", pa.int8())])
"""The columns of every file, beside those of the predictors."""
PROBABILITIES = pa.list_(pa.float32(), len(KNOWN))


class EpisodeFacts(Settings):
    """The facts of an episode, stored beside the answers.

    fingerprint: of the evaluation. decision_s: time between predictions, s. simulated_s: recorded time, s. vehicles:
    number on the road, without those that collided or teleported. instants: number of due predictions of all vehicles.
    uncovered: number of those that were not made, by reason. covered_km: distance driven while predicted.
    """

    schema_version: Literal[1] = 1
    fingerprint: str
    scenario: str
    seed: int
    decision_s: float = Field(gt=0)
    simulated_s: float = Field(ge=0)
    vehicles: int = Field(ge=0)
    instants: int = Field(ge=0)
    uncovered: dict[str, Annotated[int, Field(ge=0)]]
    covered_km: float = Field(ge=0)
    events: tuple[LiveEvent, ...]


@dataclass(frozen=True)
class LiveEpisode:
    """One episode with its n predictions, vehicle by vehicle, in order of time.

    names: of the TVs. vehicle: number of the TV in `names`, (n,). time_s: end of the window, (n,). group: group of the
    TV at that time (`events.groups_at`), (n,). answers: of each predictor by its name; those of runs that were
    trained on streams hold no features, as their alarms need none.
    """

    facts: EpisodeFacts
    names: tuple[str, ...]
    vehicle: IntArray
    time_s: Array
    group: IntArray
    answers: Mapping[str, Answers]

    @property
    def vehicle_hours(self) -> float:
        """Time for which vehicles were predicted, h."""
        return len(self.time_s) * self.facts.decision_s / 3600


def without_near_misses(episode: LiveEpisode) -> LiveEpisode:
    """Return an episode whose events are those of the labels alone."""
    events = tuple(event for event in episode.facts.events if event.left_out != NEAR_MISS)
    return replace(episode, facts=episode.facts.model_copy(update={"events": events}))


def file_name(scenario: str, seed: int, alone: bool = False) -> str:
    """Return the name of an episode's file. alone: the file of driving without a UV."""
    return f"{scenario}-{seed}{'-alone' if alone else ''}.parquet"


def write_episode(path: Path, episode: LiveEpisode) -> None:
    """Write an episode, completely or not at all. Raises OutputError."""
    columns: dict[str, Any] = {
        "tv": named_column(episode.vehicle, episode.names),
        "time_s": pa.array(episode.time_s),
        "group": pa.array(episode.group, pa.int8()),
    }
    for name, answers in episode.answers.items():
        columns[f"{name}.probabilities"] = _rows(answers.probabilities)
        columns[f"{name}.score"] = pa.array(answers.score)
        if answers.features.shape[1]:
            columns[f"{name}.features"] = _rows(answers.features)
    FILES.write(path, episode.facts, columns, row_group_size=ROW_GROUP)


def predicted_hours(path: Path) -> float:
    """Return for how many vehicle-hours an episode's file holds predictions, without reading them."""
    facts = FILES.read_facts(path)
    return 0.0 if facts is None else pq.read_metadata(path).num_rows * facts.decision_s / 3600


def read_episode(path: Path, features: bool = False) -> LiveEpisode:
    """Read an episode. features: whether to read features, too.

    Raises InputError if the file is damaged, that of another episode, or holds what no predictor answers.
    """
    facts, table = FILES.read(path, lambda column: features or not column.endswith(".features"))
    names, vehicle = names_and_numbers(table["tv"])
    predictors = dict.fromkeys(name.rpartition(".")[0] for name in table.column_names if name.endswith(".score"))
    return LiveEpisode(
        facts=facts,
        names=names,
        vehicle=vehicle,
        time_s=table["time_s"].to_numpy(),
        group=table["group"].to_numpy().astype(np.int64),
        answers={name: _answers(table, name) for name in predictors},
    )


def _check(table: pa.Table) -> None:
    """Raise ValueError, which names the column, unless a table holds what `write_episode` writes."""
    check_types(table, COLUMNS)
    predictors = [name.rpartition(".")[0] for name in table.column_names if name.endswith(".score")]
    for name in predictors:
        check_types(table, pa.schema([(f"{name}.probabilities", PROBABILITIES), (f"{name}.score", pa.float32())]))
        for part in ("probabilities", "score", "features"):
            column = f"{name}.{part}"
            if column not in table.column_names:
                continue
            values = table[column].to_numpy() if part == "score" else _matrix(table[column])
            if np.isnan(values).any():
                raise ValueError(f"{column}: is not a number in every row")
            if part == "probabilities" and len(values) and not -1e-4 <= values.min() <= values.max() <= 1.0001:
                raise ValueError(f"{column}: is not between 0 and 1")
    time_s, group = table["time_s"].to_numpy(), table["group"].to_numpy()
    vehicle = np.concatenate([np.empty(0, np.int32), *(chunk.indices.to_numpy() for chunk in table["tv"].chunks)])
    if len(group) and not 0 <= group.min() <= group.max() < len(GROUPS):
        raise ValueError("group: is not one in every row")
    if not np.isfinite(time_s).all():
        raise ValueError("time_s: is not finite")
    if ((np.diff(vehicle) < 0) | ((np.diff(vehicle) == 0) & (np.diff(time_s) <= 0))).any():
        raise ValueError("tv or time_s: is not in order")


FILES = EpisodeFiles(
    EpisodeFacts,
    b"isac_cosim.live_episode",
    lambda facts: [file_name(facts.scenario, facts.seed, alone) for alone in (False, True)],
    _check,
)


def _answers(table: pa.Table, name: str) -> Answers:
    score = table[f"{name}.score"].to_numpy()
    features = f"{name}.features"
    return Answers(
        _matrix(table[f"{name}.probabilities"]),
        score,
        _matrix(table[features]) if features in table.column_names else np.empty((len(score), 0), np.float32),
    )


def _rows(values: Float32Array) -> pa.Array:
    return pa.FixedSizeListArray.from_arrays(pa.array(values.ravel()), values.shape[1])


def _matrix(column: pa.ChunkedArray) -> Float32Array:
    parts: Sequence[npt.NDArray[np.float32]] = [chunk.flatten().to_numpy() for chunk in column.chunks]
    width: int = column.type.list_size
    return np.concatenate(parts).reshape(-1, width) if parts else np.empty((0, width), np.float32)


def no_answers(predictors: Sequence[str]) -> dict[str, Answers]:
    """Return the answers of an episode in which no vehicle was watched."""
    nothing = Answers(np.empty((0, len(KNOWN)), np.float32), np.empty(0, np.float32), np.empty((0, 1), np.float32))
    return dict.fromkeys(predictors, nothing)
