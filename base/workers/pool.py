"""Worker processes of this machine. Tasks reach them through pipes, so nothing listens that others could connect to.

Pools of the standard library and of others give up all their workers when one dies, and do not say what it was doing.
Here one worker is replaced, its task is tried again, and the others go on.
"""

from __future__ import annotations

import multiprocessing
import pickle
import shutil
import signal
import tempfile
from collections.abc import Callable, Collection, Generator, Iterable, Iterator
from contextlib import contextmanager
from multiprocessing.connection import wait
from pathlib import Path

import cloudpickle

from isac_cosim.base.errors import InputError, RunError, ShortageError
from isac_cosim.base.shortages import MEMORY_WORDS, no_memory, shortage
from isac_cosim.base.temporary import TemporaryFolder, temporary_root, writing_temporary
from isac_cosim.base.workers import interrupts
from isac_cosim.base.workers.activity import Reading
from isac_cosim.base.workers.attempts import DIED, RETRIES, Attempt, Item, Outcome, Result, Tries, describe
from isac_cosim.base.workers.threads import told_to_libraries
from isac_cosim.base.workers.worker import MESSAGES_FILE, Ready, Workplace, last_words, serve

KILLED = tuple(-getattr(signal, name) for name in ("SIGKILL", "SIGTERM", "SIGHUP") if hasattr(signal, name))
"""Exit codes of processes that others ended."""
SPAWN = multiprocessing.get_context("spawn")


class WorkerPool:
    """Worker processes, started as they are needed, and kept for the tasks that follow. See `worker_pool`.

    folder: of their temporary files. output: the folder that the command writes, if it is known.
    """

    def __init__(self, folder: Path, output: Path | None = None) -> None:
        self._folder, self._output = folder, output
        self._idle: list[_Worker] = []
        self._failed_starts = 0

    def run(
        self, task: Callable[[Item], Result], items: Iterable[Item], at_once: int
    ) -> Generator[Outcome[Item, Result]]:
        """Yield the outcome of task(item) for every item, in the order in which they finish.

        at_once: how many are run at the same time; below 1, one is. An item is taken from the iterable only when a
        worker is free for it. Closing the generator ends the running tasks.
        Raises InputError where the process dies while it reads the user's input, RunError where the machine lacks
        something, or processes do not start.
        """
        remaining = iter(items)
        busy: dict[_Worker, Tries[Item]] = {}
        try:
            while True:
                while len(busy) < max(1, at_once):
                    try:
                        tries = Tries(next(remaining))
                    except StopIteration:
                        break
                    self._begin(task, tries, busy)
                if not busy:
                    return
                worker = _first_to_answer(busy)
                attempt = worker.answer()
                if attempt is None:
                    continue
                with interrupts.deferred():
                    tries = busy.pop(worker)
                    self._release(worker)
                outcome = None if worker.never_started else tries.outcome(attempt)
                if outcome is None:
                    self._begin(task, tries, busy)
                else:
                    yield outcome
        finally:
            _end(busy)

    def close(self) -> None:
        """End the idle processes; those with tasks end with the generators."""
        _end(self._idle)
        self._idle.clear()

    def _begin(self, task: Callable[[Item], Result], tries: Tries[Item], busy: dict[_Worker, Tries[Item]]) -> None:
        """Give an item to an idle worker or to a new one."""
        content = cloudpickle.dumps((task, tries.item))
        # Otherwise a signal could leave a process behind that nobody ends.
        with interrupts.deferred():
            while True:
                worker = self._idle.pop() if self._idle else self._new_worker()
                if worker.give(content):
                    busy[worker] = tries
                    return
                worker.end()

    def _new_worker(self) -> _Worker:
        """Start a worker process. Raises RunError where none starts."""
        while True:
            try:
                return _Worker(self._folder, self._output)
            except BrokenPipeError as error:
                self._count_failed_start(describe(error))

    def _release(self, worker: _Worker) -> None:
        """Keep a worker for the next item, if it is alive. Raises RunError where one after the other does not start."""
        if worker.death is None:
            self._failed_starts = 0
            self._idle.append(worker)
            return
        worker.end()
        if worker.never_started:
            self._count_failed_start(worker.death)

    def _count_failed_start(self, reason: str) -> None:
        self._failed_starts += 1
        if self._failed_starts > RETRIES:
            raise RunError(f"the worker processes do not start ({reason})")


@contextmanager
def worker_pool(output: Path | None = None) -> Iterator[WorkerPool]:
    """Yield worker processes that end with the block. output: the folder that the command writes, if it is known."""
    with TemporaryFolder() as folder:
        pool = WorkerPool(folder.path, output)
        try:
            yield pool
        finally:
            pool.close()


class _Worker:
    """A worker process.

    Raises BrokenPipeError where it dies while it is started, RunError where the system does not start it.
    """

    def __init__(self, folder: Path, output: Path | None) -> None:
        with writing_temporary():
            self.folder = Path(tempfile.mkdtemp(prefix="worker-", dir=folder))
        workplace = Workplace(self.folder, temporary_root(), output)
        self._ready = False
        self._reading: Reading | None = None
        self._waiting: bytes | None = None
        self.death: str | None = None
        """How the process died, None while it lives."""
        try:
            self.connection, theirs = SPAWN.Pipe()
            self.process = SPAWN.Process(target=serve, args=(theirs, workplace), name="cosim worker")
            with told_to_libraries(1):
                self.process.start()
            theirs.close()
        except BrokenPipeError:
            raise
        except OSError as error:
            raise shortage(error) or RunError(f"the worker processes do not start ({describe(error)})") from None

    @property
    def never_started(self) -> bool:
        """Whether the process died before it could take a task."""
        return self.death is not None and not self._ready

    def give(self, content: bytes) -> bool:
        """Give a task to the process, or keep it until the process has started. Return whether it may still live."""
        if not self._ready:
            self._waiting = content
            return True
        try:
            self.connection.send_bytes(content)
        except OSError:
            return False
        return True

    def answer(self) -> Attempt | None:
        """Read what the process sent. Return the outcome of its task, also where it died; None if that is to come."""
        if not self.connection.poll():  # it is the process that ended, while a child of its own keeps the connection
            return self._died()
        try:
            message = pickle.loads(self.connection.recv_bytes())
        except (EOFError, OSError):
            return self._died()
        except Exception as error:  # what a result needs to be read may raise anything
            return Attempt(error=describe(error), final=True)
        if message is None or isinstance(message, Reading):
            self._reading = message
        elif isinstance(message, Ready):
            self._ready = True
            if self._waiting is not None and not self.give(self._waiting):
                return self._died()
        else:
            attempt: Attempt = message
            return attempt
        return None

    def end(self) -> None:
        """Kill the process, and delete its temporary files."""
        self.process.kill()
        self.process.join()
        self.connection.close()
        shutil.rmtree(self.folder, ignore_errors=True)

    def _died(self) -> Attempt:
        """Return what a process that died leaves behind. The error ends the command if no try is left."""
        self.process.join()
        code = self.process.exitcode or 0
        how = self.death = f"exit code {code}" if code >= 0 else f"signal {-code}, {signal.strsignal(-code)}"
        words = last_words(self.folder / MESSAGES_FILE)
        said = f" and said: {' '.join(words.split())}" if words else ""
        stop: RunError | InputError | None = None
        if MEMORY_WORDS.search(words):
            stop = no_memory(words)
        elif code in KILLED:
            stop = ShortageError(
                f"a worker process was killed in each of {RETRIES + 1} tries ({how}), as the system does where memory "
                "runs out; give fewer --jobs or a machine with more memory, and the same command goes on from there"
            )
        elif self._reading is not None:
            files = ", ".join(self._reading.files)
            stop = InputError(f"SUMO crashed while it read {self._reading.what} ({how}){said}; fix its files: {files}")
        return Attempt(error=f"{DIED} ({how}){said}", stop=stop, printed=words)


def _first_to_answer(busy: Collection[_Worker]) -> _Worker:
    """Wait until one of the workers has sent something or has died, and return it."""
    ready = wait([*(worker.connection for worker in busy), *(worker.process.sentinel for worker in busy)])
    return next(worker for worker in busy if worker.connection in ready or worker.process.sentinel in ready)


def _end(workers: Iterable[_Worker]) -> None:
    """End worker processes, all of them, also where a signal arrives meanwhile."""
    with interrupts.deferred():
        for worker in workers:
            worker.end()
