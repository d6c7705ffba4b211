"""Nobody can connect to a command on one machine: it listens nowhere."""

from __future__ import annotations

import http.server
import os
import socket
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

import psutil
import pytest

from tests.support.held_command import started
from tests.support.sockets import Address, answer, listening, tree_of
from tests.support.waiting import wait_until

pytestmark = pytest.mark.skipif(os.name != "posix", reason="process groups and their signals are of POSIX")


def test_a_plain_command_listens_nowhere(folder: Path) -> None:
    """In none of its processes, from its start until its episodes run."""
    process = started(folder, "generate road -o data --seeds 1:3 --jobs 2 --quiet")
    command, seen = psutil.Process(process.pid), set[int]()
    found: dict[Address, bytes] = {}

    def held() -> bool:
        seen.update(member.pid for member in tree_of(command))
        found.update({address: answer(address) for address in listening(command)})
        return {path.name for path in (folder / "gate").iterdir()} == {"2", "3"}

    try:
        wait_until(held, lambda: process.poll() is None)
    finally:
        (folder / "gate/open").touch()
        _, printed = process.communicate()
    assert process.returncode == 0, printed
    assert len(seen) >= 3
    assert found == {}


@contextmanager
def web_server() -> Iterator[Address]:
    with http.server.HTTPServer(("127.0.0.1", 0), http.server.BaseHTTPRequestHandler) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        try:
            yield ("127.0.0.1", server.server_port)
        finally:
            server.shutdown()
            thread.join()


@contextmanager
def greeting(name: str) -> Iterator[Address]:
    """A Unix socket that greets everyone."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as server:
        server.bind(name)
        server.listen()

        def greet() -> None:
            with suppress(OSError):
                while True:
                    connection, _ = server.accept()
                    connection.sendall(b"hello")
                    connection.close()

        thread = threading.Thread(target=greet, daemon=True)
        thread.start()
        yield name
        server.shutdown(socket.SHUT_RDWR)
        thread.join()


def test_what_listens_is_found_and_its_answer_heard(tmp_path: Path) -> None:
    """Otherwise the test above could not fail."""
    before = listening(psutil.Process())
    with ExitStack() as stack:
        opened = {stack.enter_context(web_server()), stack.enter_context(greeting(str(tmp_path / "socket")))}
        if os.path.exists("/proc/net/unix"):
            opened.add(stack.enter_context(greeting(f"\0cosim-test-{os.getpid()}")))
        assert listening(psutil.Process()) - before == opened
        answers = {address: answer(address) for address in opened}
        assert all(answers.values()), answers
