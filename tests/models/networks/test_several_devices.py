"""Training on several devices: nobody else is answered, and no process stays behind."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import psutil
import pytest

import cosim
from tests.support.sockets import Address, answer, listening
from tests.support.waiting import wait_until

pytestmark = [pytest.mark.slow, pytest.mark.skipif(os.name != "posix", reason="signals are of POSIX")]

COMMAND = """
import sys
from pathlib import Path

from isac_cosim.command_line.exit_codes import exit_code
from isac_cosim.models.training.training import train_records
from tests.support.made_up import MADE_OF, SMALL_RUN, make_records


def train():
    optimiser = SMALL_RUN.optimiser.model_copy(update={"accelerator": "cpu", "devices": 2})
    train_records(make_records(), MADE_OF, Path("run"), SMALL_RUN.model_copy(update={"optimiser": optimiser}))


if __name__ == "__main__":
    sys.exit(exit_code(train))
"""


@pytest.fixture
def training(tmp_path: Path) -> subprocess.Popen[str]:
    """A training on two processes, which stand for two devices."""
    (tmp_path / "command.py").write_text(COMMAND)
    path = os.pathsep.join(map(str, (Path(cosim.__file__).parent, *filter(None, [os.environ.get("PYTHONPATH")]))))
    return subprocess.Popen(
        [sys.executable, "command.py"],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": path, "TMPDIR": str(tmp_path)},
        stderr=subprocess.PIPE,
        text=True,
    )


def meeting(training: subprocess.Popen[str]) -> Callable[[], set[Address]]:
    """Return a function that tells where the processes listen, once both of them do."""
    process = psutil.Process(training.pid)

    def found() -> set[Address]:
        addresses = listening(process)
        return addresses if len(addresses) >= 2 else set()

    return found


def test_the_processes_answer_nobody_else(training: subprocess.Popen[str]) -> None:
    found = wait_until(meeting(training), lambda: training.poll() is None)
    assert {host for host, _ in found} == {"127.0.0.1"}  # type: ignore[misc]
    assert {address: answer(address) for address in found} == dict.fromkeys(found, b"")
    _, printed = training.communicate()
    assert (training.returncode, printed) == (0, "")


def test_the_processes_end_with_the_command(training: subprocess.Popen[str], tmp_path: Path) -> None:
    wait_until(meeting(training), lambda: training.poll() is None)
    children = psutil.Process(training.pid).children(recursive=True)
    training.send_signal(signal.SIGTERM)
    _, printed = training.communicate()
    assert training.returncode == 143, printed
    (line,) = printed.splitlines()
    assert line.startswith("cosim: interrupted")
    psutil.wait_procs(children, 30)
    assert not any(child.is_running() and child.status() != psutil.STATUS_ZOMBIE for child in children)
    assert list(tmp_path.glob("cosim-*")) == []
