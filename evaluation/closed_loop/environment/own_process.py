"""The traffic of an environment in a process of its own, because libsumo holds one simulation a process.

The process is started as a program, not as a copy of this one: a script needs no `if __name__ == "__main__"` for it,
and nothing that is open here is open there. It ends with its environment, and with the process that started it.
"""

from __future__ import annotations

import os
import pickle
import signal
import subprocess
import sys
import traceback
from collections.abc import Sequence
from contextlib import suppress
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from typing import Any

import numpy as np
import numpy.typing as npt

from isac_cosim.base.arrays import Float32Array
from isac_cosim.base.errors import InputError, RunError
from isac_cosim.evaluation.closed_loop.environment.settings import EnvironmentSettings
from isac_cosim.evaluation.closed_loop.environment.traffic import Outcome, TrafficHere

GIVEN_S = 10.0
"""How long the process may take to end, s."""
GONE = (EOFError, OSError, pickle.UnpicklingError)
"""What talking to a process raises that has ended."""


class TrafficApart:
    """`Traffic` in a process of its own, which begins with the first simulation. An error there is raised here.

    Raises RunError where the process ends by itself, as SUMO ends it after some of its errors.
    """

    def __init__(self, settings: EnvironmentSettings) -> None:
        self._settings = settings
        self._process: subprocess.Popen[bytes] | None = None
        self._connection: Connection | None = None

    def begin(self, seed: int) -> Float32Array | None:
        if self._connection is None:
            self._start()
        observation: Float32Array | None = self._ask("begin", seed)
        return observation

    def step(self, action: Sequence[int]) -> Outcome:
        outcome: Outcome = self._ask("step", action)
        return outcome

    def picture(self) -> npt.NDArray[np.uint8]:
        picture: npt.NDArray[np.uint8] = self._ask("picture")
        return picture

    def close(self) -> None:
        """End the process."""
        if self._connection is None or self._process is None:
            return
        with suppress(*GONE):
            self._connection.send(None)
        self._connection.close()
        try:
            self._process.wait(GIVEN_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._connection = None

    def _start(self) -> None:
        self._connection, there = Pipe()
        # It has to find the same packages as this process, whatever changed the path of this one.
        path = os.pathsep.join(place or os.getcwd() for place in sys.path)
        with there:
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-m", __name__, str(there.fileno())],
                pass_fds=(there.fileno(),),
                stdin=subprocess.DEVNULL,
                env={**os.environ, "PYTHONPATH": path},
            )
        self._ask("open", self._settings)

    def _ask(self, name: str, *arguments: Any) -> Any:
        """Call a method of the traffic there. What it raises is raised here."""
        assert self._connection is not None, "begin a simulation first"
        assert self._process is not None
        try:
            self._connection.send((name, arguments))
            answer, error = self._connection.recv()
        except GONE:
            self.close()
            code = self._process.returncode
            raise RunError(f"the process of this environment has ended (exit code {code}): reset begins anew") from None
        except BaseException:  # an interrupt: the answer may still come, and would be taken for the next one
            self.close()
            raise
        if error is not None:
            raise error
        return answer


def serve(connection: Connection) -> None:
    """Do what is asked through a connection until it is closed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the process that asks is interrupted, and ends this one
    traffic: TrafficHere | None = None
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
                error = RunError(f"{type(unknown).__name__} in the process of this environment: {unknown}")
            connection.send((answer, error))
    if traffic is not None:
        traffic.close()


if __name__ == "__main__":
    serve(Connection(int(sys.argv[1])))
