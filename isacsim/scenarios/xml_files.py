"""Reading XML files of others as SUMO reads them, but with bounds.

Compressed files are recognised by their content. A file with a document type is refused, so that no entity is
expanded and no other file is read. What a file may hold when decompressed is limited, so that a small one cannot fill
the memory.
"""

from __future__ import annotations

import math
import os
import xml.parsers.expat as expat
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, NamedTuple

from isac_cosim.base.errors import InputError

LIMIT_VARIABLE = "ISAC_COSIM_XML_LIMIT_GB"
"""Environment variable that sets how much is read of one file, decompressed, GB."""
LIMIT_GB = 4.0
"""Its default."""
MOST_RATIO, RATIO_FREE = 200, 64_000_000
"""A compressed file may hold this many times its size, or this many bytes. SUMO's files compress 10 to 40 times."""
LONGEST_PIECE = 16_000_000
"""Longest tag, comment or instruction, in bytes. The parser holds a whole one in memory."""
DEEPEST = 200
"""Elements within elements."""
BLOCK = 1 << 18
"""Bytes read at once."""
XML_FAULTS = (expat.ExpatError, EOFError, LookupError, OSError, ValueError, zlib.error)
"""What reading other files raises."""
ENCODING_FAULTS = (4, 9, 18, 19)
"""The parser's codes of what a wrong encoding makes of a file: an invalid token, a misplaced declaration, ..."""
PLAIN_ENCODINGS = (None, "utf-8", "us-ascii", "ascii")
"""Declared encodings in which every parser reads the same bytes alike."""
WIDE = (b"\xfe\xff", b"\xff\xfe", b"\0", b"<\0")
"""How files in UTF-16 and UTF-32 begin."""
GZIP, ZLIB = b"\x1f\x8b", (b"\x78\x01", b"\x78\x9c", b"\x78\xda")
"""How the compressed files begin that SUMO reads, whatever their names."""


class Element(NamedTuple):
    """The beginning of an element. depth: 0 for the root. name, attributes: as written, prefixes included."""

    depth: int
    name: str
    attributes: dict[str, str]


class _RefusedError(Exception):
    """A file breaks a rule; the message says which, and what to do."""


class XmlReader:
    """Reads the elements of an XML file in their order, and keeps nothing of them.

    most_bytes: how much is read, decompressed; by default, what the setting says. texts: if given, receives the text
    that follows the beginning of each element.
    Once the file has been read, `plain` says whether any XML parser would read the same: version 1.0 in UTF-8, and
    compressed with gzip if at all.
    """

    def __init__(self, file: Path, most_bytes: float | None = None, texts: list[str] | None = None) -> None:
        self.plain = True
        self._file = file
        self._most = limit_bytes() if most_bytes is None else most_bytes
        self._texts = texts
        self._begun: list[Element] = []
        self._depth = 0
        self._parser = expat.ParserCreate()
        self._parser.StartElementHandler = self._start
        self._parser.EndElementHandler = self._end
        self._parser.XmlDeclHandler = self._declaration
        if texts is not None:
            self._parser.CharacterDataHandler = self._text
        self._parser.StartDoctypeDeclHandler = self._document_type

    def elements(self) -> Iterator[Element]:
        """Yield the elements of the file, each as it begins. Raises InputError where the file cannot be read."""
        with _named(self._file), self._file.open("rb") as packed:
            fed = 0
            for block in self._blocks(packed):
                self._parser.Parse(block, False)
                fed += len(block)
                if fed - self._parser.CurrentByteIndex > LONGEST_PIECE:
                    raise _RefusedError(f"has a tag or comment of more than {LONGEST_PIECE // 10**6} MB: shorten it")
                yield from self._begun
                self._begun.clear()
            self._parser.Parse(b"", True)
            yield from self._begun

    def _blocks(self, file: IO[bytes]) -> Iterator[bytes]:
        """Yield the content, decompressed, in blocks. Compressed files are recognised by their first bytes."""
        size = os.fstat(file.fileno()).st_size
        first = file.read(4)
        file.seek(0)
        blocks, held = _plain, size
        if first.startswith((GZIP, *ZLIB)):
            # Measured before it is parsed, which takes a hundred times as long.
            blocks, held = _decompressed, 0
            for block in _decompressed(file):
                held += len(block)
                if held > self._most:
                    break
                if held > max(MOST_RATIO * size, RATIO_FREE):
                    raise _RefusedError(f"holds more than {MOST_RATIO} times its size: decompress it, if you trust it")
            file.seek(0)
        if held > self._most:
            raise _RefusedError(f"holds more than {self._most / 1e9:g} GB: set {LIMIT_VARIABLE} higher if you trust it")
        self.plain = not first.startswith(ZLIB)
        begins = True
        for block in blocks(file):
            self.plain &= not (begins and block.startswith(WIDE))
            begins = False
            yield block

    def _start(self, name: str, attributes: dict[str, str]) -> None:
        self._begun.append(Element(self._depth, name, attributes))
        if self._texts is not None:
            self._texts.append("")
        self._depth += 1
        if self._depth > DEEPEST:
            raise _RefusedError(f"has more than {DEEPEST} elements within each other: fix it")

    def _end(self, _: str) -> None:
        self._depth -= 1

    def _text(self, text: str) -> None:
        assert self._texts is not None
        self._texts[-1] += text

    def _declaration(self, version: str, encoding: str | None, _: int) -> None:
        self.plain &= version == "1.0" and (encoding and encoding.lower()) in PLAIN_ENCODINGS

    def _document_type(self, *_: object) -> None:
        raise _RefusedError(
            "declares a document type (DTD), which can read other files or expand without end: remove the DTD"
        )


def _plain(file: IO[bytes]) -> Iterator[bytes]:
    """Yield what a file holds, in blocks."""
    while block := file.read(BLOCK):
        yield block


def _decompressed(file: IO[bytes]) -> Iterator[bytes]:
    """Yield what a compressed file of either format holds, in blocks. It may have several parts."""
    part = zlib.decompressobj(zlib.MAX_WBITS + 32)
    packed = file.read(BLOCK)
    while packed:
        if part.eof:
            part = zlib.decompressobj(zlib.MAX_WBITS + 32)
        if block := part.decompress(packed, BLOCK):
            yield block
        packed = (part.unused_data if part.eof else part.unconsumed_tail) or file.read(BLOCK)
    while block := part.decompress(b"", BLOCK):
        yield block
    if not part.eof:
        raise EOFError("the compressed file ends early")


def elements(file: Path) -> Iterator[Element]:
    """Yield the elements of an XML file, each as it begins. Raises InputError where the file cannot be read."""
    return XmlReader(file).elements()


def read_through(file: Path) -> None:
    """Raise InputError where an XML file cannot be read, declares a document type or breaks a limit."""
    for _ in elements(file):
        pass


def limit_bytes() -> float:
    """Return how many bytes of one file are read, decompressed. Raises InputError where the setting is no number."""
    given = os.environ.get(LIMIT_VARIABLE, "")
    try:
        limit = float(given or LIMIT_GB)
    except ValueError:
        limit = math.nan
    if not limit > 0.0:
        raise InputError(f"{LIMIT_VARIABLE} = {given!r} is not a number above 0: give GB, or remove the variable")
    return limit * 1e9


@contextmanager
def _named(file: Path) -> Iterator[None]:
    """Turn errors of reading a file into an InputError that names it."""
    try:
        yield
    except _RefusedError as refused:
        raise InputError(f"{file} {refused}") from None
    except XML_FAULTS as error:
        code = getattr(error, "code", None)
        encoded = isinstance(error, LookupError | ValueError) or code in ENCODING_FAULTS
        fix = "fix the file, or save it in UTF-8" if encoded else "fix the file"
        raise InputError(f"{file} cannot be read as XML ({one_line(error)}): {fix}") from None


def write_lines(file: Path, text: str) -> None:
    """Write a text file with the same bytes on every system: UTF-8, and line feeds alone."""
    file.write_text(text, encoding="utf-8", newline="\n")


def one_line(error: object) -> str:
    """Return an error's text without line breaks."""
    return " ".join(str(error).split()) or type(error).__name__
