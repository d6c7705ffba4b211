"""A dataset of streams, opened: what is in it, and its episodes one after the other."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Container, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import Field
from rich.console import Console
from rich.table import Table

from isac_cosim.base.errors import InputError
from isac_cosim.base.files import DIGEST, file_digest
from isac_cosim.base.settings import Sealed, read_json
from isac_cosim.isacsim.scene.scores import scene_line, scene_scores
from isac_cosim.labeling.dataset.dataset import ROADS, RoadLane, read_roads
from isac_cosim.labeling.dataset.meta import ScenarioMeta
from isac_cosim.labeling.intentions import KNOWN
from isac_cosim.labeling.streams.events import NEAR_MISS
from isac_cosim.labeling.streams.settings import StreamDatasetSettings
from isac_cosim.labeling.streams.store import FILES, STRETCHES, StoredStretch, StreamFacts, read_stretches

META_FILE = "streams.json"


class StreamsMeta(Sealed):
    """The content of `streams.json`.

    fingerprint: of everything that the streams depend on. study: the dataset section of the study. settings: what is
    stored. files: digest of every file by its path in the folder, empty until all episodes are there.
    """

    sealed_since: ClassVar[int] = 1

    schema_version: Literal[1] = 1
    complete: bool
    fingerprint: str
    study: dict[str, Any]
    settings: StreamDatasetSettings
    versions: dict[str, str]
    scenarios: tuple[ScenarioMeta, ...]
    files: dict[str, Annotated[str, Field(pattern=DIGEST)]] = Field(default_factory=dict)


@dataclass(frozen=True)
class Streams:
    """A dataset of streams in a folder."""

    path: Path
    meta: StreamsMeta

    @classmethod
    def open(cls, path: str | Path) -> Self:
        """Open a folder. Raises InputError if it holds no finished dataset of streams."""
        folder = Path(path)
        meta = read_json(StreamsMeta, folder / META_FILE)
        if meta is None:
            raise InputError(f"{folder}: no dataset of streams (no {META_FILE}); make one: cosim generate --streams")
        if not meta.complete:
            raise InputError(f"{folder}: is not finished; run the same `cosim generate --streams` again")
        return cls(folder, meta)

    @property
    def digest(self) -> str:
        """SHA-256 digest of the names and digests of all files."""
        lines = "".join(f"{name} {digest}\n" for name, digest in sorted(self.meta.files.items()))
        return hashlib.sha256(lines.encode()).hexdigest()

    @property
    def episodes(self) -> list[str]:
        """The names of the files of stretches, in the order of the study."""
        return [name.partition("/")[2] for name in self.meta.files if name.startswith(f"{STRETCHES}/")]

    def verify(self) -> None:
        """Reread every file. Raises InputError at the first that is missing, differs from its digest or is damaged."""
        for name in self.meta.files:
            self._check_digest(name)
        for _ in self.read():
            pass

    def read(self, episodes: Container[str] | None = None) -> Iterator[tuple[StreamFacts, list[StoredStretch]]]:
        """Yield the episodes, one at a time in memory. Raises InputError where a file is damaged.

        episodes: `<scenario>-<seed>` of those to read; all by default.
        """
        for name in self.episodes:
            if episodes is None or name.removesuffix(".parquet") in episodes:
                self._check_digest(f"{STRETCHES}/{name}")
                yield read_stretches(self.path / STRETCHES / name)

    def roads(self, scenario: str) -> list[RoadLane]:
        """Return the lanes of a scenario. Raises InputError if their file is missing, damaged or was changed."""
        name = f"{ROADS}/{scenario}.parquet"
        self._check_digest(name)
        try:
            return read_roads(self.path / name)
        except (OSError, ValueError) as error:
            reason = " ".join(str(error).split())
            raise InputError(
                f"{self.path / name}: is not a file of roads ({reason}); delete it and run the same "
                "`cosim generate --streams` again"
            ) from None

    def _check_digest(self, name: str) -> None:
        """Raise InputError if a file, by its path in the folder, is missing or was changed."""
        path = self.path / name
        if not path.is_file() or file_digest(path) != self.meta.files.get(name):
            fault = "differs from its digest" if path.is_file() else "is missing"
            raise InputError(f"{path}: {fault}; delete it and run the same `cosim generate --streams` again")

    def facts(self) -> list[StreamFacts]:
        """Return the facts of all episodes, without reading their stretches. Raises InputError if a file is damaged."""
        facts = []
        for name in self.episodes:
            of_episode = FILES.read_facts(self.path / STRETCHES / name)
            if of_episode is None:
                raise InputError(f"{self.path / STRETCHES / name}: is damaged or missing; delete it and generate again")
            facts.append(of_episode)
        return facts


def summary(streams: Streams) -> dict[str, Any]:
    """Return what is in a dataset of streams, as plain values.

    `vehicle_hours` have decisions; `coverage` is their share of all driving, and `uncovered` says why there are none in
    the rest. Events `counted` are those of watched vehicles with a UV. `scene`, only where the sites sense all vehicles
    at once: how well the network knew who was where, over all episodes.
    """
    facts = streams.facts()
    instants = sum(of.instants for of in facts)
    hours = sum(of.decisions * of.decision_s for of in facts) / 3600
    uncovered = sum((Counter(of.uncovered) for of in facts), Counter[str]())
    events = [event for of in facts for event in of.events]
    by_intention = {}
    for known in KNOWN:
        of_kind = [event for event in events if event.intention == known.text]
        counted = sum(event.left_out is None for event in of_kind)
        nearly = sum(event.left_out == NEAR_MISS for event in of_kind)
        by_intention[known.text] = {
            "counted": counted,
            "per_vehicle_hour": round(counted / hours, 3) if hours else None,
            "near_misses": nearly,
            "neutral": len(of_kind) - counted - nearly,
        }
    return {
        "path": str(streams.path),
        "digest": streams.digest,
        "episodes": len(facts),
        "seeds": [f"{of.scenario}-{of.seed}" for of in facts],
        "vehicle_hours": round(hours, 6),
        "driving_hours": round(sum(of.instants * of.decision_s for of in facts) / 3600, 6),
        "coverage": sum(of.decisions for of in facts) / instants if instants else None,
        "uncovered": {reason: number / instants for reason, number in sorted(uncovered.items())},
        "by_intention": by_intention,
        **scene_scores(of.scene for of in facts),
        "bytes": sum((streams.path / name).stat().st_size for name in streams.meta.files),
    }


def show(values: dict[str, Any], console: Console) -> None:
    """Print a summary on a console."""

    def line(text: str) -> None:
        console.print(text, highlight=False, soft_wrap=True, markup=False)

    line(f"{values['path']}, digest {values['digest'][:12]}: streams of {values['episodes']} episodes")
    table = Table("intention", "events", "an hour", "near misses", "neutral")
    for name, row in values["by_intention"].items():
        rate = "-" if row["per_vehicle_hour"] is None else f"{row['per_vehicle_hour']:.1f}"
        table.add_row(name, str(row["counted"]), rate, str(row["near_misses"]), str(row["neutral"]))
    console.print(table)
    share = "-" if values["coverage"] is None else f"{100 * values['coverage']:.0f} %"
    rest = ", ".join(f"{reason.replace('_', ' ')} {100 * part:.0f} %" for reason, part in values["uncovered"].items())
    line(f"{values['vehicle_hours']:.2f} vehicle-hours, {share} of the driving (not: {rest})")
    if "scene" in values:
        line(scene_line(values["scene"]))
    line(f"{values['bytes'] / 1e6:.1f} MB")
