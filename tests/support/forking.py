"""Runs commands in children of one warmed process, each with a limit on its time and memory.

A process that has imported everything answers a command in a tenth of the time. It works on one thread, so that its
children find no locks that a thread of the parent held. A child that crashes or hangs takes nothing else along.
"""

from __future__ import annotations

import gc
import json
import os
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
SECONDS = 60
"""Processor time for a command, s; and time for which it may wait for nothing, s. A busy machine is no fault of it."""
MEMORY = 3 * 2**30
"""What a command may take beyond what the warmed process has, bytes."""


@dataclass(frozen=True)
class Ended:
    """How a command ended. code: its exit code, negative for a signal; None if it waited for ever."""

    code: int | None
    out: str
    err: str


class WarmedProcess:
    """The process that has imported everything. Use it as a context."""

    def __enter__(self) -> WarmedProcess:
        environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
        self._process = subprocess.Popen(
            [sys.executable, "-m", __name__], cwd=ROOT, env=environment, text=True,
            stdin=subprocess.PIPE, stdout=subprocess.PIPE,
        )  # fmt: skip
        return self

    def __exit__(self, *_: object) -> None:
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.wait()

    def run(self, folder: Path, commands: Sequence[Sequence[str]]) -> Ended:
        """Run commands in a folder, one after the other until one fails."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        print(json.dumps([str(folder), commands]), file=self._process.stdin, flush=True)
        return Ended(**json.loads(self._process.stdout.readline()))


def serve() -> None:
    """What the warmed process does: a line of JSON for each line of JSON."""
    warm()
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    for line in sys.stdin:
        folder, commands = json.loads(line)
        print(json.dumps(asdict(in_child(Path(folder), commands))), file=answers, flush=True)


def warm() -> None:
    """Import what the commands import, and leave out the drawing of figures, which takes most of their time."""
    import matplotlib

    matplotlib.use("agg")
    import torch

    torch.set_num_threads(1)
    import lightning.pytorch
    import pyarrow.dataset
    import pyarrow.pandas_compat
    import scipy.stats
    import sklearn.covariance
    import sklearn.ensemble
    import skops.io

    import cosim
    from isac_cosim.command_line import arguments, live, options
    from isac_cosim.command_line import evaluation as evaluating
    from isac_cosim.command_line import training as learning
    from isac_cosim.evaluation.on_windows import evaluation
    from isac_cosim.evaluation.report import report
    from isac_cosim.evaluation.report.roads import picture
    from isac_cosim.labeling.dataset import summary
    from isac_cosim.labeling.generation import resense
    from isac_cosim.models.training import training
    from tests.support.scripted import InlineEngine

    del lightning, pyarrow, scipy, skops, sklearn, cosim, summary, resense, evaluation, training
    del arguments, evaluating, live, learning
    # A command's own worker processes would be warmed anew for every case.
    options.engine_of = lambda *_: InlineEngine()
    report.draw_figures = lambda *_: None
    report.draw_record = lambda *_: None
    picture.draw_road = lambda *_: None
    torch.nn.Linear(2, 2)(torch.ones(1, 2))
    # Else the first collection of garbage in each child would copy all of the parent's memory.
    gc.collect()
    gc.freeze()


def in_child(folder: Path, commands: Sequence[Sequence[str]]) -> Ended:
    """Run commands in a child of this process."""
    streams = [folder / name for name in ("stdout.txt", "stderr.txt")]
    child = os.fork()
    if not child:
        code = 70
        try:
            code = _command(folder, commands, streams)
        finally:
            for stream in (sys.stdout, sys.stderr):
                stream.flush()
            os._exit(code)
    status = _waited(child)
    out, err = (stream.read_text(errors="replace") if stream.exists() else "" for stream in streams)
    return Ended(status, out, err)


def _command(folder: Path, commands: Sequence[Sequence[str]], streams: Sequence[Path]) -> int:
    import cosim

    for number, stream in enumerate(streams, start=1):
        os.dup2(os.open(stream, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), number)
    os.chdir(folder)
    used = int(Path("/proc/self/statm").read_text().split()[0]) * os.sysconf("SC_PAGE_SIZE")
    resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY, used + MEMORY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS))
    for words in commands:
        if code := cosim.main(words):
            return code
    return 0


def _waited(child: int) -> int | None:
    """Return a child's exit code, negative for a signal; None if it waited for ever, and was ended."""
    worked, since, pause = -1, time.monotonic(), 0.002
    while time.monotonic() < since + SECONDS:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            return os.waitstatus_to_exitcode(status)
        state, *_, user, system = Path(f"/proc/{child}/stat").read_text().rpartition(")")[2].split()[:13]
        if state != "S" or worked != int(user) + int(system):
            worked, since = int(user) + int(system), time.monotonic()
        time.sleep(pause)
        pause = min(0.05, pause * 1.3)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return None


if __name__ == "__main__":
    serve()
