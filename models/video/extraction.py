"""Makes clips from pairs of videos: all pairs are checked first, finished clips are kept, none is written by half."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import JsonValue

from isac_cosim.base.errors import InputError, RunError
from isac_cosim.base.feedback import Feedback
from isac_cosim.base.files import claim, file_digest, remove_partial, replace_file
from isac_cosim.base.landlock import confined
from isac_cosim.base.settings import write_sealed
from isac_cosim.base.stored.arrays import read_arrays
from isac_cosim.base.stored.errors import READ_ERRORS
from isac_cosim.base.workers.attempts import Outcome
from isac_cosim.base.workers.engine import Engine
from isac_cosim.base.workers.missing import Tally, run_missing
from isac_cosim.base.workers.threads import limited
from isac_cosim.models.data.clips import BACKGROUND, MANIFEST, Extraction, View, extraction_in
from isac_cosim.models.video.encoders import VIEWS, Encoder, encoder
from isac_cosim.models.video.files import Facts, facts_of, opencv
from isac_cosim.models.video.pairs import ACTIONS, STRAIGHT, IncompleteError, VideoPair, pairs_in
from isac_cosim.models.video.pictures import check_span, driver_corner, driver_pictures, places_of, road_pictures
from isac_cosim.models.video.settings import VideoSettings
from isac_cosim.models.video.speeds import read_speeds, speeds_at

SOURCE = "source"
"""Name, in a clip's file, of the digests of what it was made from, as in `Extraction.clips`."""
CHECKED_KEPT = 50
"""So many pairs are checked before the progress bar moves."""


@dataclass(frozen=True)
class Weights:
    """Files of the networks' weights; None for random ones."""

    road: Path | None = None
    driver: Path | None = None

    def of(self, view: View) -> Path | None:
        """Return the file of a view."""
        return self.road if view == "road" else self.driver


@dataclass(frozen=True)
class CheckedPair:
    """A pair that can become a clip, and what its videos say of themselves."""

    pair: VideoPair
    road: Facts
    driver: Facts


@dataclass(frozen=True)
class ClipTask:
    """A clip to make. file: where it goes."""

    checked: CheckedPair
    settings: VideoSettings
    weights: Weights
    file: Path


def extract_clips(
    videos: Path,
    out: Path,
    settings: VideoSettings,
    weights: Weights,
    engine: Engine,
    feedback: Feedback,
    complete_only: bool = False,
) -> Extraction:
    """Make a clip in `out` of every pair of videos in a folder, unless an earlier call has; return what was made.

    complete_only: leave out incomplete pairs, as the paper does, rather than refuse them: without one of the views or
    speeds, shorter than a clip, or of different lengths. Raises InputError where the videos, the weights or the folder
    are wrong, or the folder's clips were made with other settings; RunError where a worker process fails.
    """
    cv2 = opencv()
    digests: dict[str, JsonValue] = {}
    for view in VIEWS:
        encoder(view, weights.of(view), settings)
        digests[view] = None if weights.of(view) is None else file_digest(weights.of(view))  # type: ignore[arg-type]
    pairs, left_out = _checked(pairs_in(videos), settings, feedback, complete_only)
    made: dict[str, JsonValue] = {
        "settings": settings.model_dump(mode="json"),
        "weights": digests,
        "sizes": {"road": list(pairs[0].road.size), "driver": list(pairs[0].driver.size)},
        "versions": {"opencv": cv2.__version__, "torch": version("torch")},
    }
    random: list[View] = [view for view in VIEWS if weights.of(view) is None]
    begun = Extraction(finished=False, random=random, made=made, clips={}, left_out=left_out)
    with claim(out, MANIFEST, "clips"):
        _check_folder(out, begun, {each.pair.name for each in pairs})
        write_sealed(out / MANIFEST, begun)
        remove_partial(out, "*.npz")
        tasks = [ClipTask(each, settings, weights, out / f"{each.pair.name}.npz") for each in pairs]
        sources = _made(tasks, engine, feedback)
        done = begun.model_copy(update={"finished": True, "clips": dict(sorted(sources.items()))})
        write_sealed(out / MANIFEST, done)
    return done


def _checked(
    pairs: list[VideoPair], settings: VideoSettings, feedback: Feedback, complete_only: bool
) -> tuple[list[CheckedPair], dict[str, str]]:
    """Return the pairs that can become clips, and why the others cannot, by name. Raises InputError."""
    found: list[CheckedPair] = []
    left_out: dict[str, str] = {}
    with feedback.bar("checking", "pairs") as move:
        for number, pair in enumerate(pairs, 1):
            try:
                checked = confined(partial(check, pair, settings))
            except IncompleteError as error:
                if not complete_only:
                    raise
                left_out[pair.name] = str(error)
                continue
            if found:
                _check_size(checked, found[0])
            found.append(checked)
            if number % CHECKED_KEPT == 0:
                move(number, len(pairs))
    if not found:
        raise InputError(f"all {len(pairs)} pairs are incomplete, for example: {next(iter(left_out.values()))}")
    return found, left_out


def check(pair: VideoPair, settings: VideoSettings) -> CheckedPair:
    """Return a pair with what its videos say of themselves. Raises IncompleteError or InputError if it is no clip."""
    checked = CheckedPair(pair, facts_of(pair.road), facts_of(pair.driver))
    for path, facts in ((pair.road, checked.road), (pair.driver, checked.driver)):
        check_span(path, facts, pair.maneuver_s, settings)
    lengths_s = checked.road.duration_s, checked.driver.duration_s
    if pair.maneuver_s is None and abs(lengths_s[0] - lengths_s[1]) > settings.tolerance_s:
        raise IncompleteError(
            f"{pair.driver}: is {lengths_s[1]:.2f} s, the view of the road {lengths_s[0]:.2f} s, so they do not end "
            "together; leave the pair out"
        )
    driver_corner(pair.driver, checked.driver, settings)
    _speeds(checked, settings, checked.driver.frames)
    return checked


def _speeds(checked: CheckedPair, settings: VideoSettings, frames: int) -> Any:
    """Return the smoothed speeds of a clip, (T,). frames: that the video of the driver holds."""
    pair, rate_hz = checked.pair, checked.driver.rate_hz
    speeds = read_speeds(pair.speed)
    if abs(len(speeds) - frames) > settings.tolerance_s * rate_hz:
        raise IncompleteError(
            f"{pair.speed}: holds the speeds of {len(speeds)} frames, and the video {frames}; leave the pair out"
        )
    places = places_of(frames, checked.driver, pair.maneuver_s, settings)
    per_mean = round(settings.speed_mean_s * settings.rate_hz)
    return speeds_at(speeds, frames, places, per_mean, settings.speed_known, pair.speed)


def _check_size(checked: CheckedPair, first: CheckedPair) -> None:
    """Raise InputError where a video's frames are of another size than those of the first pair."""
    views = (checked.pair.road, checked.road, first.road), (checked.pair.driver, checked.driver, first.driver)
    for path, facts, others in views:
        if facts.size != others.size:
            own, common = (f"{size[0]}x{size[1]}" for size in (facts.size, others.size))
            raise InputError(f"{path}: frames of {own}, where others have {common}; convert it, or leave the pair out")


def _check_folder(out: Path, begun: Extraction, names: set[str]) -> None:
    """Raise InputError where the clips in a folder are of other videos, or were made otherwise."""
    before = extraction_in(out)
    if before is not None:
        for part, now in begun.made.items():
            if before.made.get(part) != now:
                raise InputError(f"{out}: its clips were made with other {part}; choose another folder")
    if foreign := {file.stem for file in out.glob("[!.]*.npz")} - names:
        raise InputError(f"{out / min(foreign)}.npz: is no clip of these videos; delete it, or choose another folder")


def _made(tasks: list[ClipTask], engine: Engine, feedback: Feedback) -> dict[str, list[str]]:
    """Make the clips; return what each was made from, by name."""
    sources: dict[str, list[str]] = {}
    tally = Tally(len(tasks))

    def keep(outcome: Outcome[ClipTask, list[str]]) -> None:
        if outcome.result is None:
            raise RunError(f"{outcome.item.checked.pair.driver}: {outcome.error}")
        sources[outcome.item.checked.pair.name] = outcome.result
        tally.done += 1

    run_missing(extract_clip, tasks, engine, feedback, title="extracting", unit="clips", keep=keep, progress=tally)
    return sources


def extract_clip(task: ClipTask) -> list[str]:
    """Make a clip, unless its file is of the same videos and speeds already. Returns what it was made from.

    Decoders read what comes from outside: meanwhile, their thread can neither write files nor open connections.
    """
    pair = task.checked.pair
    source = [file_digest(path) for path in (pair.road, pair.driver, pair.speed)] + [str(pair.maneuver_s)]
    if not _is_kept(task.file, source, pair.label):
        opencv()
        arrays = confined(partial(_arrays, task))
        content: dict[str, Any] = {
            **arrays, "label": pair.label, BACKGROUND: ACTIONS.index(STRAIGHT), SOURCE: np.array(source)
        }  # fmt: skip
        replace_file(task.file, lambda partial: np.savez(partial, **content))
    return source


def clip_of(
    checked: CheckedPair, settings: VideoSettings, encoder_of: Callable[[View], Callable[[Any], Any]]
) -> dict[str, Any]:
    """Return the arrays `in` and `out` of a clip, (T, 65) and (T, 33) with the paper's widths, the speed last.

    encoder_of: returns what turns the pictures of a view, (T, 3, H, W), into features, (T, width).
    """
    road = encoder_of("road")(road_pictures(checked.pair, checked.road, settings))
    pictures, _, held = driver_pictures(checked.pair, checked.driver, settings)
    driver = encoder_of("driver")(pictures)
    speed = _speeds(checked, settings, held)[:, None]
    for path, features in ((checked.pair.road, road), (checked.pair.driver, driver)):
        if not np.isfinite(features).all():
            raise InputError(f"{path}: its features are not finite: the network's weights are damaged; replace them")
    return {"in": np.hstack([driver, speed]), "out": np.hstack([road, speed])}


@limited()
def _arrays(task: ClipTask) -> dict[str, Any]:
    settings = task.settings.model_dump_json()
    return clip_of(task.checked, task.settings, lambda view: _loaded(view, task.weights.of(view), settings))


@cache
def _loaded(view: View, weights: Path | None, settings: str) -> Encoder:
    """Return the encoder of a view, which a worker process builds once. settings: as JSON."""
    return encoder(view, weights, VideoSettings.model_validate_json(settings))


def _is_kept(file: Path, source: list[str], label: int) -> bool:
    """Return whether a file is the clip of these videos and speeds, whole."""
    try:
        stored = read_arrays(file)
        return bool(stored[SOURCE].tolist() == source and stored["label"].tolist() == label)
    except READ_ERRORS:
        return False
