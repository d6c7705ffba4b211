"""The traffic of an environment outside of the thread that the environment is in, asked through a connection.

SUMO runs in a thread that can write nothing but temporary files (`base.landlock`): in this process, or in one of its
own, because libsumo holds one simulation a process. A process of its own is started as a program, not as a copy of this
one: a script needs no `if __name__ == "__main__"` for it, and nothing that is open here is open there. It ends with its
environment, and with the process that started it.
"""

from __future__ import annotations

import os
import pickle
import signal
import subprocess
import sys
import threading
import traceback
from abc import ABC, abstractmethod
from collections.abc import Sequence
from contextlib import suppress
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from typing import Any

import numpy as np
import numpy.typing as npt

from isac_cosim.base import landlock
from isac_cosim.base.arrays import Float32Array
from isac_cosim.base.errors import InputError, RunError
from isac_cosim.evaluation.closed_loop.environment.settings import EnvironmentSettings
from isac_cosim.evaluation.closed_loop.environment.traffic import StepOutcome, TrafficHere

GIVEN_S = 10.0
"""How long a process may take to end, s."""
GONE = (EOFError, OSError, pickle.UnpicklingError)
"""What talking through a connection raises whose other end is gone."""


class Served(ABC):
    """`Traffic` that is served elsewhere, from the first simulation on. An error there is raised here.

    Raises RunError where the one that serves has ended by itself, as SUMO ends its process after some errors.
    """

    def __init__(self) -> None:
        self._connection: Connection | None = None

    def begin(self, seed: int) -> Float32Array | None:
        """As `Traffic.begin`."""
        if self._connection is None:
            self._connection, there = Pipe()
            self._start(there)
        observation: Float32Array | None = self._ask("begin", seed)
        return observation

    def step(self, action: Sequence[int]) -> StepOutcome:
        """As `Traffic.step`."""
        outcome: StepOutcome = self._ask("step", action)
        return outcome

    def picture(self) -> npt.NDArray[np.uint8]:
        """As `Traffic.picture`."""
        picture: npt.NDArray[np.uint8] = self._ask("picture")
        return picture

    def close(self) -> None:
        """End the simulation, and the one that serves it."""
        if self._connection is None:
            return
        with suppress(*GONE):
            self._connection.send(None)
        self._connection.close()
        self._connection = None
        self._end()

    @abstractmethod
    def _start(self, there: Connection) -> None:
        """Have the traffic served through a connection, which belongs to the one that serves."""

    @abstractmethod
    def _end(self) -> None:
        """Wait until the one that serves has ended."""

    @property
    @abstractmethod
    def _why(self) -> str:
        """What is known of why the one that served has ended."""

    def _ask(self, name: str, *arguments: Any) -> Any:
        """Call a method of the traffic there. What it raises is raised here."""
        assert self._connection is not None, "begin a simulation first"
        try:
            self._connection.send((name, arguments))
            answer, error = self._connection.recv()
        except GONE:
            self.close()
            raise RunError(f"the simulation of this environment has ended{self._why}: reset begins anew") from None
        except BaseException:  # an interrupt: the answer may still come, and would be taken for the next one
            self.close()
            raise
        if error is not None:
            raise error
        return answer


class TrafficInThread(Served):
    """`Traffic` in a thread of this process."""

    def __init__(self, traffic: TrafficHere) -> None:
        super().__init__()
        self._traffic = traffic
        self._thread: threading.Thread | None = None

    def _start(self, there: Connection) -> None:
        # A daemon, because the end of a process waits for other threads before it closes what is open.
        self._thread = threading.Thread(
            target=_serve_confined, args=(there, self._traffic), name="environment", daemon=True
        )
        self._thread.start()

    def _end(self) -> None:
        # The collector of garbage may find a forgotten environment in that very thread.
        if self._thread is not None and self._thread is not threading.current_thread():
            self._thread.join()

    @property
    def _why(self) -> str:
        return ""


class TrafficInProcess(Served):
    """`Traffic` in a process of its own."""

    def __init__(self, settings: EnvironmentSettings) -> None:
        super().__init__()
        self._settings = settings
        self._process: subprocess.Popen[bytes] | None = None

    def _start(self, there: Connection) -> None:
        # It has to find the same packages as this process, whatever changed the path of this one.
        path = os.pathsep.join(place or os.getcwd() for place in sys.path)
        with there:
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-c", f"from {__name__} import main; main({there.fileno()})"],
                pass_fds=(there.fileno(),),
                stdin=subprocess.DEVNULL,
                env={**os.environ, "PYTHONPATH": path},
            )
        self._ask("open", self._settings)

    def _end(self) -> None:
        if self._process is None:
            return
        try:
            self._process.wait(GIVEN_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    @property
    def _why(self) -> str:
        return f" with its process (exit code {self._process.returncode})" if self._process is not None else ""


def main(descriptor: int) -> None:
    """Serve traffic in this process, which was started for that. descriptor: of the connection."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the process that asks is interrupted as well, and ends this one
    _serve_confined(Connection(descriptor))


def _serve_confined(connection: Connection, traffic: TrafficHere | None = None) -> None:
    with connection, suppress(*GONE):
        try:
            landlock.confined(lambda: _serve(connection, traffic))
        except RunError as error:  # it cannot be confined
            connection.send((None, error))


def _serve(connection: Connection, traffic: TrafficHere | None) -> None:
    """Do what is asked until the other end is gone or says so. traffic: None where its settings are the first thing."""
    with suppress(*GONE):
        while (asked := connection.recv()) is not None:
            name, arguments = asked
            answer: Any = None
            error: InputError | RunError | None = None
            try:
                if traffic is None:
                    traffic = TrafficHere(*arguments)
                else:
                    answer = getattr(traffic, name)(*arguments)
            except (InputError, RunError) as known:
                error = known
            except Exception as unknown:
                traceback.print_exc()
                error = RunError(f"{type(unknown).__name__} in the simulation of this environment: {unknown}")
            connection.send((answer, error))
    if traffic is not None:
        traffic.close()
