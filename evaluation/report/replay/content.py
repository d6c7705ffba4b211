"""What the page's replay shows, and how it is packed: a record's three paths take 1.5 kB.

`replay.js` reads this; a change of one is a change of the other.
"""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Annotated, Any

import numpy as np
from pydantic import PlainSerializer, PlainValidator

from isac_cosim.base.arrays import Array
from isac_cosim.labeling.intentions import spoken

RATE_HZ = 25.0
"""Places of the TV and the UV, and of what was sensed, a second."""
LARGEST = 32_767
"""Of a packed number."""
STEP_M = 0.01
"""Of packed places, m, where they lie within 327 m of a record's middle."""
STEP_S = 0.2
"""About the time between the places of another vehicle; between them the page interpolates, s."""
NEAR_M = 250.0
"""Vehicles that come so near to the TV are shown, m."""
LENGTH_M, WIDTH_M = 4.5, 1.8
"""Drawn size of a vehicle whose size is not known, m."""


def _places(value: Any) -> Array:
    """Return places, (2, n), from plain values. Raises ValueError where they are none."""
    places = np.array(value, np.float64)
    if places.ndim != 2 or len(places) != 2 or not np.isfinite(places).all():
        raise ValueError("are no places: two rows of as many finite numbers")
    return places


def _table(value: Any) -> Array:
    """Return a table of numbers from plain values. Raises ValueError where it is none."""
    table = np.array(value, np.float64)
    if table.ndim != 2 or not np.isfinite(table).all():
        raise ValueError("is no table of finite numbers")
    return table


Places = Annotated[Array, PlainValidator(_places), PlainSerializer(lambda places: places.tolist())]
"""Places in m, (2, n), that can be stored."""
Table = Annotated[Array, PlainValidator(_table), PlainSerializer(lambda table: table.tolist())]
"""Other numbers, in rows, that can be stored."""


@dataclass(frozen=True)
class VehicleNear:
    """Another vehicle near a record.

    from_s, step_s: time of its first place, s after the record's start, and from one to the next. places: of its front
    bumper, m, in the scenario's plane, (2, n).
    """

    id: str
    kind: str
    length_m: float
    width_m: float
    from_s: float
    step_s: float
    places: Places


@dataclass(frozen=True)
class TrackPath:
    """A track of the network near a record: where it holds a vehicle to be, and how well it thinks to know.

    number: of the track. from_s, step_s: as of a vehicle. places: m, (2, n). spread: covariances of the places, xx, xy
    and yy, m², (3, n).
    """

    number: str
    from_s: float
    step_s: float
    places: Places
    spread: Table

    def packed(self, middle: Array, step: float) -> dict[str, Any]:
        """Return the track as plain values. middle, step: of packed places."""
        finest = max(float(np.abs(self.spread).max()) / LARGEST, 1e-6)
        return {
            "number": self.number,
            "from": round(self.from_s, 4),
            "step": round(self.step_s, 4),
            "places": pack(self.places, middle, step),
            "spread": pack(self.spread, np.zeros(3), finest),
            "finest": finest,
        }


@dataclass(frozen=True)
class Detected:
    """The detections of all panels near a record, instant by instant. places: of each instant, m, (D, 2)."""

    from_s: float
    step_s: float
    places: Sequence[Table]

    def packed(self, middle: Array, step: float) -> dict[str, Any]:
        """Return the detections as plain values; those that lie nowhere on the plane are left out."""
        found = [places[np.isfinite(places).all(axis=1)] for places in self.places]
        return {
            "from": round(self.from_s, 4),
            "step": round(self.step_s, 4),
            "counts": [len(places) for places in found],
            "places": pack(np.concatenate([np.empty((0, 2)), *found]).T, middle, step),
        }


@dataclass(frozen=True)
class Inside:
    """What a module of a predictor does with the windows of a record. names: of k lines. values: (k, n), from 0."""

    title: str
    names: Sequence[str]
    values: Table

    def packed(self) -> dict[str, Any]:
        """Return the lines as plain values: bytes, of which 255 is the top of the axis."""
        top = max(1.0, float(np.ceil(self.values.max(initial=0.0))))
        shares = np.rint(255 * np.clip(self.values / top, 0, 1)).astype(np.uint8)
        lines = [base64.b64encode(line.tobytes()).decode() for line in shares]
        return {"title": self.title, "top": top, "names": [*self.names], "lines": lines}


@dataclass(frozen=True)
class AnswersAlong:
    """What a predictor answers along a record.

    from_s, step_s: ends of the windows, s after the record's start. probabilities: (n, G). predicted: the likeliest
    intention at the last window that an evaluation measures; None where there is no such window. wrong: whether that
    is another than the label; None where the predictor was not trained on the label's intention. inside: what its
    modules do with the windows.
    """

    from_s: float
    step_s: float
    probabilities: Table
    predicted: str | None
    wrong: bool | None
    inside: Sequence[Inside] = ()


@dataclass(frozen=True)
class Maneuver:
    """What the TV really does. onset_s, commit_s: s after the record's start. note: why it does not count, if so."""

    intention: str
    onset_s: float
    commit_s: float
    note: str = ""


@dataclass(frozen=True)
class ShownAlarm:
    """An alarm for the TV. time_s: s after the record's start. false: whether it belongs to no maneuver; None where
    that is not judged."""

    intention: str
    time_s: float
    false: bool | None


@dataclass(frozen=True)
class Told:
    """An instruction to a vehicle.

    says: what it asks for. alarm: on which it was sent. sent_s: s after the record's start. begun_s, ended_s: when the
    vehicle began and ceased to follow it; None where it did not while it was simulated. fate: what became of it.
    """

    vehicle: str
    says: str
    alarm: str
    sent_s: float
    begun_s: float | None
    ended_s: float | None
    fate: str


@dataclass(frozen=True)
class Moving:
    """One record, or stretch of running traffic, that can be replayed.

    Times are in s after its start, paths (2, n) in m in the scenario's plane. maneuvers: of the TV, by onset.
    truth, sensed, uv: places of the TV as it drove and as it was sensed, and of the UV as it reported (in running
    traffic: as it drove), at RATE_HZ. sensed_from_s, uv_from_s: when the latter two begin. sizes: length and width of
    the TV and of the UV, m. others: vehicles near them; empty where they are not known. name: in the list; by default,
    the id and the answer. about: a sentence on what is shown; by default, ids and times. tracks, detected: of a scene.
    told: instructions to vehicles, in the order in which they were sent.
    """

    id: str
    intention: str
    origin: str
    tv_id: str
    uv_id: str
    start_s: float
    maneuvers: Sequence[Maneuver]
    truth: Places
    sensed: Places
    uv: Places
    sizes: tuple[tuple[float, float], tuple[float, float]] = ((LENGTH_M, WIDTH_M), (LENGTH_M, WIDTH_M))
    others: Sequence[VehicleNear] = ()
    answers: AnswersAlong | None = None
    alarms: Sequence[ShownAlarm] = ()
    sensed_from_s: float = 0.0
    uv_from_s: float = 0.0
    name: str = ""
    about: str = ""
    tracks: Sequence[TrackPath] = ()
    detected: Detected | None = None
    told: Sequence[Told] = ()

    @property
    def shown_name(self) -> str:
        """What the list of records calls it."""
        if self.name:
            return self.name
        wrong = self.answers is not None and self.answers.wrong and self.answers.predicted
        return f"{self.id}: {spoken(self.intention)}" + (f", taken for {spoken(wrong)} ✗" if wrong else "")

    @property
    def shown_about(self) -> str:
        """What is said of it below the road."""
        if self.about:
            return self.about
        times = "".join(
            f", onset after {one.onset_s:.2f} s, commit after {one.commit_s:.2f} s" for one in self.maneuvers[:1]
        )
        return (
            f"TV {self.tv_id}, UV {self.uv_id}: {spoken(self.intention)} ({self.origin}), from {self.start_s:.1f} s of "
            f"the simulation{times}."
        )

    def packed(self) -> dict[str, Any]:
        """Return the record as plain values for the page."""
        paths = [self.truth, self.sensed, self.uv]
        beside = [*(vehicle.places for vehicle in self.others), *(track.places for track in self.tracks)]
        every = np.concatenate([*paths, *beside], axis=1)
        middle = np.round((every.min(axis=1) + every.max(axis=1)) / 2)
        step = max(STEP_M, float(np.abs(every - middle[:, None]).max()) / LARGEST)
        truth, sensed, uv = (pack(path, middle, step) for path in paths)
        content: dict[str, Any] = {
            "id": self.id,
            "intention": self.intention,
            "about": self.shown_about,
            "sizes": self.sizes,
            "maneuvers": [
                [one.intention, round(one.onset_s, 3), round(one.commit_s, 3), one.note] for one in self.maneuvers
            ],
            "alarms": [[one.intention, round(one.time_s, 3), one.false] for one in self.alarms],
            "from": {"sensed": round(self.sensed_from_s, 3), "uv": round(self.uv_from_s, 3)},
            "rate": RATE_HZ,
            "middle": middle.tolist(),
            "step": step,
            "truth": truth,
            "sensed": sensed,
            "uv": uv,
            "others": [
                {
                    "id": vehicle.id,
                    "kind": vehicle.kind,
                    "size": [round(vehicle.length_m, 2), round(vehicle.width_m, 2)],
                    "from": round(vehicle.from_s, 4),
                    "step": round(vehicle.step_s, 4),
                    "places": pack(vehicle.places, middle, step),
                }
                for vehicle in self.others
            ],
        }
        if self.told:
            shown: dict[str, str | int] = {one.id: k for k, one in enumerate(self.others)}
            shown |= {self.tv_id: "tv", self.uv_id: "uv"}
            content["told"] = [{**asdict(one), "shown": shown.get(one.vehicle)} for one in self.told]
        if self.detected is not None:
            content["scene"] = {
                "tracks": [track.packed(middle, step) for track in self.tracks],
                "detected": self.detected.packed(middle, step),
            }
        if (answers := self.answers) is not None:
            shares = np.clip(np.rint(255 * answers.probabilities), 0, 255).astype(np.uint8)
            content["answers"] = {
                "from": round(answers.from_s, 3),
                "step": round(answers.step_s, 4),
                "probabilities": base64.b64encode(shares.tobytes()).decode(),
                "predicted": answers.predicted,
                "wrong": answers.wrong,
                "inside": [module.packed() for module in answers.inside],
            }
        return content


@dataclass(frozen=True)
class Replay:
    """What can be replayed on a page.

    records: the ones to choose from, the first of which is shown. lanes: width and centre line (n, 2) of lanes near
    them, m. sites: id, x, y, m, and azimuth, compass degrees. classes: intentions of the predictor, none without one.
    remarks: sentences on what is shown and what is not. noun: what the page calls one of the records.
    """

    title: str
    records: Sequence[Moving]
    lanes: Sequence[tuple[float, Table]]
    sites: Sequence[tuple[str, float, float, float]]
    classes: Sequence[str] = ()
    remarks: Sequence[str] = ()
    noun: str = "record"

    @property
    def some_wrong(self) -> bool:
        """Whether the predictor was asked, and is not wrong in all records: the next wrong one is then worth a key."""
        verdicts = {record.answers.wrong for record in self.records if record.answers is not None}
        return bool(verdicts) and verdicts != {True}

    @property
    def modules(self) -> int:
        """How many modules of the predictor are shown, at most."""
        return max((len(record.answers.inside) for record in self.records if record.answers is not None), default=0)

    def beginning_with(self, record: str) -> Replay:
        """Return the replay with the record of this id in front; as it is where there is none."""
        return replace(self, records=sorted(self.records, key=lambda moving: moving.id != record))

    def packed(self) -> dict[str, Any]:
        """Return everything as plain values for the page."""
        return {
            "classes": [*self.classes],
            "noun": self.noun,
            "lanes": [
                {"width": round(width, 2), "line": np.round(line, 2).reshape(-1).tolist()} for width, line in self.lanes
            ],
            "sites": [[name, round(x, 2), round(y, 2), round(azimuth, 1)] for name, x, y, azimuth in self.sites],
            "records": [record.packed() for record in self.records],
        }


def pack(path: Array, middle: Array, step: float) -> str:
    """Return places as base64 text of little-endian 16-bit numbers: x and y of one place after the other.

    path: (2, n), m; or other values, (k, n). middle: the place that is 0, (2,), m. step: of the numbers, m.
    """
    numbers = np.rint((path - middle[:, None]) / step)
    return base64.b64encode(np.clip(numbers, -LARGEST, LARGEST).T.astype("<i2").tobytes()).decode()


def at_rate(states: Array, rate_hz: float, wanted_hz: float = RATE_HZ) -> Array:
    """Return the places of states, (6, n) at a rate, at another rate from the first one on, (2, m), m."""
    times = np.arange(states.shape[1]) / rate_hz
    instants = np.arange(int(times[-1] * wanted_hz + 1e-6) + 1) / wanted_hz
    return np.stack([np.interp(instants, times, states[k]) for k in (0, 1)])
