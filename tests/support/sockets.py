"""The sockets at which the processes of a command listen, and whether they answer somebody without credentials."""

from __future__ import annotations

import contextlib
import os
import socket
import sys
from pathlib import Path

import psutil

UNIX_SOCKETS = Path("/proc/net/unix")
LISTENING_FLAG = 0x10000
"""Of a Unix socket that accepts connections, in that file."""
PROBES = (b"", b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n", b"\x00" * 64, bytes(range(256)))
"""What is said to a socket, one after the other: nothing, a web browser's words, and noise."""
PATIENCE_S = 0.5
"""How long an answer may take, s."""

Address = tuple[str, int] | str
"""Host and port, or the name of a Unix socket, which begins with a zero byte if it is no file."""


def tree_of(process: psutil.Process) -> list[psutil.Process]:
    return [process, *process.children(recursive=True)]


def listening(process: psutil.Process) -> set[Address]:
    """Return where a process and those that it started listen, TCP, UDP and Unix sockets alike."""
    found: set[Address] = set()
    for member in tree_of(process):
        with contextlib.suppress(psutil.NoSuchProcess):
            for connection in member.net_connections("inet"):
                bound = connection.type == socket.SOCK_DGRAM and not connection.raddr
                if connection.status == psutil.CONN_LISTEN or bound:
                    found.add((connection.laddr.ip, connection.laddr.port))
            found |= _unix_sockets(member)
    return found


def _unix_sockets(process: psutil.Process) -> set[Address]:
    """Return the Unix sockets at which a process listens, abstract ones included; psutil does not tell which do."""
    if not sys.platform.startswith("linux"):
        return {connection.laddr for connection in process.net_connections("unix") if connection.laddr}
    inodes = set()
    for descriptor in Path(f"/proc/{process.pid}/fd").iterdir():
        with contextlib.suppress(OSError):
            inodes.add(os.readlink(descriptor))
    names: set[Address] = set()
    for line in UNIX_SOCKETS.read_text().splitlines()[1:]:
        fields = line.split()
        if f"socket:[{fields[6]}]" in inodes and int(fields[3], 16) & LISTENING_FLAG:
            names.add(fields[7].replace("@", "\0", 1) if len(fields) > 7 else "")
    return names


def answer(address: Address) -> bytes:
    """Return what a socket says to somebody who connects to it and has no credentials; nothing if it keeps silent."""
    said = b""
    for probe in PROBES:
        with contextlib.suppress(OSError), _connected(address) as connection:
            connection.settimeout(PATIENCE_S)
            with contextlib.suppress(OSError):  # it may have spoken and closed already
                connection.sendall(probe)
            said += connection.recv(1024)
    return said


def _connected(address: Address) -> socket.socket:
    if isinstance(address, str):
        connection = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        connection.connect(address)
        return connection
    host = {"0.0.0.0": "127.0.0.1", "::": "::1"}.get(address[0], address[0])
    return socket.create_connection((host, address[1]), PATIENCE_S)
