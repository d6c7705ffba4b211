"""Which videos belong together: the folders of Brain4Cars, or a table of one's own.

As published, Brain4Cars has for every event CLIP of the kind ACTION (end_action, lchange, lturn, rchange, rturn):

    face_camera/ACTION/CLIP/video_CLIP.avi     the driver
    face_camera/ACTION/CLIP/params_CLIP.mat    the speed of every frame, among other things
    road_camera/ACTION/CLIP.avi                the road

CLIP is DATE_TIME_FIRST_LAST, of the frames of a longer drive at 30 a second. A `car_state.txt` beside params_CLIP.mat
is read in its place. These names are those that public code for the dataset uses; the dataset itself was not at hand.

Other videos come with a table `clips.csv` in their folder, which then counts alone:

    name,label,road,driver,speed,maneuver_s
    drive-7,lchange,7/road.mp4,7/cabin.mp4,7/speed.csv,12.4

label: one of the actions, or its number. road, driver, speed: files in the folder. maneuver_s: when the maneuver
begins, s of both videos; without it, or where it is empty, at the end of each.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path, PurePosixPath

from isac_cosim.base.errors import InputError
from isac_cosim.base.files import shortened

ACTIONS = ("end_action", "lchange", "lturn", "rchange", "rturn")
"""The classes of Brain4Cars, by their number here: driving straight on, changes of lane and turns, left and right."""
STRAIGHT = ACTIONS[0]
FACE, ROAD = "face_camera", "road_camera"
TABLE = "clips.csv"
NEEDED, OPTIONAL = ("name", "label", "road", "driver", "speed"), ("maneuver_s",)
NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,149}")
MOST_TABLE_BYTES = 10_000_000
MOST_MANEUVER_S = 1e5


class IncompleteError(InputError):
    """A pair of videos lacks something that a clip needs. The paper leaves such pairs out."""


@dataclass(frozen=True)
class VideoPair:
    """The two views of one event, and what is known of it.

    name: of the clip. label: number of its class. speed: file of the speeds. maneuver_s: begin of the maneuver, s of
    both videos; None for their ends. The files need not exist.
    """

    name: str
    label: int
    road: Path
    driver: Path
    speed: Path
    maneuver_s: float | None = None


def pairs_in(videos: Path) -> list[VideoPair]:
    """Return all pairs in a folder, by name. Raises InputError where there are none, or a name or a row is wrong."""
    if not videos.is_dir():
        raise InputError(f"{videos}: no such folder; give the folder of the videos")
    table = videos / TABLE
    if table.is_file():
        pairs = list(_listed(table))
    elif (videos / FACE).is_dir() and (videos / ROAD).is_dir():
        pairs = list(_published(videos))
    else:
        raise InputError(f"{videos}: holds neither {TABLE} nor the folders {FACE} and {ROAD} of Brain4Cars; give one")
    if not pairs:
        raise InputError(f"{videos}: holds no pairs of videos; give a folder that does")
    for before, pair in pairwise(pairs):
        if before.name.lower() == pair.name.lower():
            raise InputError(f"{videos}: two clips are called {pair.name}, upper and lower case aside; rename one")
    return pairs


def _published(videos: Path) -> Iterator[VideoPair]:
    """Yield the events of Brain4Cars, also those that only one of the views has."""
    for view in (FACE, ROAD):
        for folder in sorted(videos.joinpath(view).iterdir()):
            if folder.is_dir() and folder.name not in ACTIONS:
                raise InputError(f"{folder}: is none of {', '.join(ACTIONS)}; move it elsewhere")
    for label, action in enumerate(ACTIONS):
        drivers, roads = videos / FACE / action, videos / ROAD / action
        events = {path.name for path in drivers.glob("*") if path.is_dir()}
        for event in sorted(events | {path.stem for path in roads.glob("*.avi")}, key=str.lower):
            _check_name(event, f"{drivers.parent.parent}")
            inside = drivers / event
            stated = inside / "car_state.txt"
            speed = stated if stated.is_file() else inside / f"params_{event}.mat"
            yield VideoPair(f"{action}-{event}", label, roads / f"{event}.avi", inside / f"video_{event}.avi", speed)


def _listed(table: Path) -> Iterator[VideoPair]:
    """Yield the rows of a table, by name."""
    try:
        with table.open("rb") as file:
            content = file.read(MOST_TABLE_BYTES + 1)
        if len(content) > MOST_TABLE_BYTES:
            raise InputError(f"{table}: has more than {MOST_TABLE_BYTES} bytes; give a shorter table")
        rows = list(csv.reader(content.decode("utf-8-sig").splitlines(), strict=True))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{table}: is no readable table ({error}); write it as CSV in UTF-8") from None
    header = [name.strip() for name in rows[0]] if rows else []
    if not set(NEEDED) <= set(header) <= {*NEEDED, *OPTIONAL} or len(set(header)) < len(header):
        raise InputError(f"{table}: its columns have to be {', '.join(NEEDED)}, and {OPTIONAL[0]} if wanted")
    pairs = []
    for number, row in enumerate(rows[1:], 2):
        if row and len(row) != len(header):
            raise InputError(f"{table}, line {number}: has {len(row)} cells, not {len(header)}; correct it")
        if row:
            cells = dict(zip(header, (cell.strip() for cell in row), strict=True))
            pairs.append(_pair(table.parent, cells, f"{table}, line {number}"))
    yield from sorted(pairs, key=lambda pair: pair.name.lower())


def _pair(videos: Path, cells: dict[str, str], where: str) -> VideoPair:
    """Return the pair in a row; where: of the row."""
    _check_name(cells["name"], where)
    label = cells["label"]
    if label in ACTIONS:
        number = ACTIONS.index(label)
    elif label.isascii() and label.isdigit() and len(label) == 1 and int(label) < len(ACTIONS):
        number = int(label)
    else:
        raise InputError(f"{where}: label {shortened(label)} is none of {', '.join(ACTIONS)}, nor 0 to 4; correct it")
    road, driver, speed = (_inside(videos, cells[view], where) for view in ("road", "driver", "speed"))
    return VideoPair(cells["name"], number, road, driver, speed, _instant(cells.get("maneuver_s", ""), where))


def _instant(text: str, where: str) -> float | None:
    """Return an instant of a video, s; None where it is not given."""
    if not text:
        return None
    try:
        instant_s = float(text)
    except ValueError:
        instant_s = -1.0
    if not 0 < instant_s <= MOST_MANEUVER_S:
        raise InputError(f"{where}: maneuver_s {shortened(text)} is no time after the video's begin, s; correct it")
    return instant_s


def _check_name(name: str, where: str) -> None:
    """Raise InputError where a name cannot be part of the name of a file."""
    if not NAME.fullmatch(name):
        raise InputError(
            f"{where}: {shortened(name)} cannot be the name of a clip: use at most 150 letters of English, digits, "
            "'_', and after the first also '-' and '.'"
        )


def _inside(videos: Path, name: str, where: str) -> Path:
    """Return the path of a file in the folder of the videos. Raises InputError where the name leads elsewhere."""
    path = PurePosixPath(name.replace("\\", "/"))
    if not path.parts or path.is_absolute() or ".." in path.parts or not name.isprintable() or ":" in name:
        raise InputError(f"{where}: {shortened(name)} is no file in the folder of the videos; give a path inside it")
    return videos / path
