"""Every command, ended at a random moment by any signal and repeated, leaves the bytes of an undisturbed one.

In a third of the cases the clock is set back by a day while the command runs, and before it is repeated.
`COSIM_KILLS=10 pytest -m slow tests/test_kills.py` ends each command ten times, more than a hundred times in all, and
`COSIM_STOPPED_S=60` stops it for a minute rather than for five seconds.
"""

from __future__ import annotations

import contextlib
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Any

import psutil
import pytest

import cosim
from isac_cosim.isacsim.scenarios.scenario import bundled
from tests.support.held_command import NOTHING_IGNORED
from tests.support.made_up_videos import write_event
from tests.support.waiting import HANGING_S, wait_until

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(os.name != "posix", reason="process groups and their signals are of POSIX"),
]

ROOT = Path(cosim.__file__).parent
KILLS = int(os.environ.get("COSIM_KILLS", "3"))
"""How often each command is ended."""
STOPPED_S = float(os.environ.get("COSIM_STOPPED_S", "5"))
"""How long each command is stopped."""
SIGNALS = (signal.SIGKILL, signal.SIGTERM, signal.SIGINT, signal.SIGHUP)
SCRIPT = """
import os, sys, time
from pathlib import Path

from isac_cosim.isacsim.traffic.sources.registry import MOTION_SOURCES
from isac_cosim.isacsim.traffic.sources.simulated import SumoSource
from tests.support.scripted import ScriptedSource

SCRIPTED = ScriptedSource(Path("road").resolve(), pause_s=0.3)


class Traffic(SumoSource):
    "Traffic from formulas, in episodes that last."

    load, inputs, digest, record = SCRIPTED.load, SCRIPTED.inputs, SCRIPTED.digest, SCRIPTED.record
    remarks, drivers_at, expected_cpu_s = SCRIPTED.remarks, SCRIPTED.drivers_at, SCRIPTED.expected_cpu_s


MOTION_SOURCES._items["sumo"] = Traffic

if "BACK_AFTER_S" in os.environ:
    clock, steady = time.time, time.monotonic
    back_at = steady() + float(os.environ["BACK_AFTER_S"])
    time.time = lambda: clock() - (86400.0 if steady() > back_at else 0.0)

if __name__ == "__main__":
    import cosim

    sys.exit(cosim.main())
"""
MAP = """<?xml version="1.0"?>
<osm version="0.6">
<node id="1" lat="52.0" lon="10.0" version="1"/><node id="2" lat="52.0" lon="10.01" version="1"/>
<node id="3" lat="52.0" lon="10.02" version="1"/><node id="4" lat="51.995" lon="10.015" version="1"/>
<way id="100" version="1"><nd ref="1"/><nd ref="2"/><nd ref="3"/>
<tag k="highway" v="motorway"/><tag k="lanes" v="3"/><tag k="oneway" v="yes"/></way>
<way id="101" version="1"><nd ref="2"/><nd ref="4"/>
<tag k="highway" v="motorway_link"/><tag k="lanes" v="1"/><tag k="oneway" v="yes"/></way>
</osm>
"""
STUDY = """
[dataset]
scenarios = ["road"]
seeds = { first = 1, last = 8 }
record = { tv_rate_hz = 40.0, uv_rate_hz = 20.0 }

[training]
asi_bip = { hidden = 8, width = 8, heads = 2, encoder_layers = 1, tv_pool = 4, uv_pool = 4 }
optimiser = { epochs = 4, threads = 1 }
trees = { rounds = 5 }
pre_onset = { rounds = 5 }
"""
SWEEP = """
[sweep]
snr = ["0", "10"]
models = ["trees"]
"""
COMMANDS = {
    "run": "run study.toml -o {out} --jobs 2",
    "generate": "generate road -o {out} --seeds 1:8 --jobs 2",
    "sense": "sense made/dataset -o {out} --snr -10:0 --jobs 2",
    "train": "train made/dataset -o {out} --epochs 4",
    "train --model trees": "train made/dataset -o {out} --model trees",
    "sweep": "run sweep.toml -o {out} --jobs 2",
    "evaluate --data": "evaluate made/run --data made/dataset -o {out}",
    "evaluate --traffic": "evaluate trees --traffic road -o {out} --seeds 1001:1003 --development 2001:2003 --jobs 2",
    "reproduce": "reproduce asi-bip --quick --stages truth -o {out} --jobs 2",
    "clips": "clips videos -o {out} --driver-cut 64x64 --jobs 2",
    "network import": "network import map.osm -o {out} --vehicles 10",
    "network sites": "network sites bare -o {out}",
}
OF_THE_RUN = ("log.jsonl", "speed.json", ".lock")
"""Files that say how long something took, or nothing."""
SPENT = ("seconds", "cpu_s", "window_ms")
"""Keys of JSON files that say so."""
met: Counter[str] = Counter()
"""How the commands ended that were sent a signal, by command."""


@dataclass(frozen=True)
class Undisturbed:
    """What a command leaves if nothing disturbs it, and how long it takes, s."""

    content: dict[str, Any]
    took_s: float


@pytest.fixture(scope="module", autouse=True)
def report() -> Iterator[None]:
    """Print, with `pytest -s`, how the commands ended."""
    yield
    print(dict(sorted(met.items())))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of all commands, with what they read: a study, its results, and a run of trees."""
    folder = tmp_path_factory.mktemp("kills")
    (folder / "road").mkdir()
    (folder / "temporary").mkdir()
    (folder / "script.py").write_text(SCRIPT)
    (folder / "study.toml").write_text(STUDY)
    (folder / "sweep.toml").write_text(STUDY + SWEEP)
    (folder / "map.osm").write_text(MAP)
    shutil.copytree(bundled()["straight_road"], folder / "bare")
    (folder / "bare" / "sites.add.xml").write_text("<additional/>")
    for event in range(4):
        write_event(folder / "videos", "lturn", f"20141019_09103{event}_1_26", 25, rate_hz=5)
    for words in ("run study.toml -o made --jobs 2", "train made/dataset -o trees --model trees"):
        assert finish(folder, words) == (0, "")
    return folder


@pytest.fixture(scope="module")
def undisturbed(folder: Path) -> Callable[[str], Undisturbed]:
    """What a command leaves, made when first asked for."""

    @cache
    def of(name: str) -> Undisturbed:
        # Twice, so that nothing is compared that no two commands share.
        contents, out = [], folder / "out"
        for _ in range(2):
            began = time.monotonic()
            assert finish(folder, COMMANDS[name].format(out=out)) == (0, "")
            contents.append(content_of(out))
            shutil.rmtree(out)
        assert contents[0] == contents[1]
        return Undisturbed(contents[0], time.monotonic() - began)

    return of


def start(folder: Path, words: str, environment: Mapping[str, str] = MappingProxyType({})) -> subprocess.Popen[str]:
    """Start a command at the head of a process group of its own."""
    path = os.pathsep.join(map(str, (ROOT, *filter(None, [os.environ.get("PYTHONPATH")]))))
    return subprocess.Popen(
        [*NOTHING_IGNORED, sys.executable, "script.py", *words.split(), "--quiet"],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": path, "TMPDIR": str(folder / "temporary"), **environment},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


def finish(folder: Path, words: str) -> tuple[int, str]:
    """Run a command to its end. Returns its exit code, and what it printed besides warnings."""
    process = start(folder, words)
    _, printed = process.communicate()
    lines = [line for line in printed.splitlines() if not line.startswith("warning: ")]
    return process.returncode, "\n".join(lines)


def in_session(leader: int) -> list[psutil.Process]:
    """The processes that a command left behind, of which `leader` was the first."""
    left = []
    for process in psutil.process_iter():
        with contextlib.suppress(psutil.NoSuchProcess, ProcessLookupError):
            if os.getsid(process.pid) == leader and process.status() != psutil.STATUS_ZOMBIE:
                left.append(process)
    return left


def content_of(out: Path) -> dict[str, Any]:
    """Return the content of all files in a folder, but for what says how long something took."""
    files = [path for path in sorted(out.rglob("*")) if path.is_file() and path.name not in OF_THE_RUN]
    return {
        str(path.relative_to(out)): content_of_json(path.read_bytes()) if path.suffix == ".json" else path.read_bytes()
        for path in files
    }


def content_of_json(stored: bytes) -> Any:
    """Return plain values without what says how long something took, and without a digest that covers it."""
    before = json.loads(stored)
    values = without_spent(before)
    if values != before and isinstance(values, dict):
        values.pop("sha256", None)
    return values


def without_spent(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: without_spent(item) for key, item in value.items() if key not in SPENT}
    return [without_spent(item) for item in value] if isinstance(value, list) else value


@pytest.mark.parametrize("turn", range(KILLS))
@pytest.mark.parametrize("name", COMMANDS)
def test_a_command_that_was_ended_is_finished_by_the_same_command(
    folder: Path, undisturbed: Callable[[str], Undisturbed], name: str, turn: int
) -> None:
    draw, before = random.Random(f"{name} {turn}"), undisturbed(name)
    number, group = draw.choice(SIGNALS), draw.random() < 0.5
    out = folder / "out"
    words = COMMANDS[name].format(out=out)
    set_back = {"BACK_AFTER_S": "0.5"} if draw.random() < 1 / 3 else {}
    process = start(folder, words, set_back)
    try:
        # From the first imports on: before them, Python itself answers an interrupt.
        time.sleep(0.5 + draw.random() * before.took_s)
        with contextlib.suppress(ProcessLookupError):
            (os.killpg if group else os.kill)(process.pid, number)
        _, printed = process.communicate(timeout=HANGING_S)
        met[f"{name} {process.returncode}"] += 1
        lines = [line for line in printed.splitlines() if not line.startswith("warning: ")]
        if number == signal.SIGKILL or process.returncode == 0:
            assert lines == [], printed
        elif process.returncode == -number:
            # Before Python has begun to listen to signals, or when it no longer does: nothing is done, or all.
            assert lines == [], printed
            assert not out.exists() or content_of(out) == before.content
        else:
            assert process.returncode == 128 + number, printed
            assert [line.startswith("cosim: interrupted") for line in lines] == [True], printed
        # Until then they hold their temporary folders.
        wait_until(lambda: not in_session(process.pid))
        if set_back:
            tomorrow = time.time() + 86400
            for path in (*out.rglob("*"), *(folder / "temporary").iterdir()):
                os.utime(path, (tomorrow, tomorrow), follow_symlinks=False)
        code, printed = finish(folder, words)
        if name.startswith("network") and code == 2:
            assert "not an empty folder" in printed, printed  # it had already finished
        else:
            assert (code, printed) == (0, "")
        assert content_of(out) == before.content
        assert list((folder / "temporary").glob("cosim-*")) == []
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        shutil.rmtree(out, ignore_errors=True)


@pytest.mark.parametrize("name", COMMANDS)
def test_a_command_that_is_stopped_for_a_while_goes_on(
    folder: Path, undisturbed: Callable[[str], Undisturbed], name: str
) -> None:
    """The command and its workers, as by Ctrl-Z or a laptop's lid."""
    out, before = folder / "out", undisturbed(name)
    process = start(folder, COMMANDS[name].format(out=out))
    time.sleep(0.5 * before.took_s)
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGSTOP)
    time.sleep(STOPPED_S)
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGCONT)
    process.communicate()
    assert process.returncode == 0
    assert content_of(out) == before.content
    shutil.rmtree(out)
