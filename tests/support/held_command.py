"""The command line with scripted traffic, some of whose episodes never end by themselves, in a process of its own."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import cosim
from tests.support.waiting import wait_until

ROOT = Path(cosim.__file__).parent
COMMAND = """
import sys
from functools import partial
from pathlib import Path

from isac_cosim.labeling.generation import generate, resense
from tests.support.scripted import ScriptedSource

road, gate = Path("road"), Path("gate")
source = ScriptedSource(road.resolve(), held=(2, 3), gate=gate.resolve())
generate.generate = partial(generate.generate, source=source)
write_shard = resense.write_shard


def write_or_wait(folder, samples, episode, *lengths):
    "In the workers of `cosim sense`, which load this file, too."
    if episode.seed in source.held:
        source._pass_gate(episode.seed)
    return write_shard(folder, samples, episode, *lengths)


resense.write_shard = write_or_wait

if __name__ == "__main__":
    import cosim

    sys.exit(cosim.main())
"""
NOTHING_IGNORED = ("env", "--default-signal=INT,HUP") if sys.platform.startswith("linux") else ()
"""Before a command: what nohup starts, or a shell in the background, ignores signals that a terminal sends."""


def make_folder(folder: Path) -> None:
    """Write the command, whose episodes of seeds 2 and 3 never end, and make its folder for temporary files."""
    (folder / "command.py").write_text(COMMAND)
    for name in ("road", "gate", "temporary"):
        (folder / name).mkdir()


def started(folder: Path, words: str, *before: str) -> subprocess.Popen[str]:
    """Start the command as a terminal does: at the head of a process group of its own. before: words before it."""
    path = os.pathsep.join(map(str, (ROOT, *filter(None, [os.environ.get("PYTHONPATH")]))))
    return subprocess.Popen(
        [*NOTHING_IGNORED, *before, sys.executable, "command.py", *words.split()],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": path, "TMPDIR": str(folder / "temporary")},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


def wait_until_held(process: subprocess.Popen[str], folder: Path) -> None:
    """Wait until both workers are at an episode that never ends."""
    held = {"2", "3"}
    wait_until(lambda: {path.name for path in (folder / "gate").iterdir()} == held, lambda: process.poll() is None)
