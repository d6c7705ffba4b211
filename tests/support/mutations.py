"""Inputs that are nearly right: settings, files and command lines with something in them changed."""

from __future__ import annotations

import copy
import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hypothesis import strategies as st

ODD_NUMBERS = (0, -1, 1, 2, 7, 1e-9, -0.0, 0.5, 1e9, 1e308, -1e308, 2**31, 2**63, 10**30, -(10**30))
ODD_TEXTS = (
    "", " ", "\n", "\x00", "\x1b[31mred", "ü", "道路", "\u202egnp", "a" * 5000, "../..", "/etc/passwd", "/dev/null",
    ".", "~", "motorway", "%s%n", "$HOME", "1e5", "nan", "inf", "-inf", "true", "null", "0:10", "link", "2.5 km",
    "[bold]x", "[/]",
)  # fmt: skip
INSERTED = (b"<", b">", b'"', b"\x00", b"nan", b"inf", b"-1", b"1e999", b"&x;", b"9" * 400, b"{", b"]")
ATTRIBUTES = ("", "nan", "inf", "-1", "1e999", "x", "0", "1,2 3", "ü", "../x", "9" * 40, "0,0 0,0", "5,5")
REPLACED = (b"", b"\xff\xfe\x00", b"\x1f\x8b\x08", b"{}", b"[]", b"null", b"<a/>", b"<a>" * 4000)
KEYS = ("", "sede", "ü", "a b", "a.b", "\x1b[31m", "0", "__class__", "first", "scenarios", "x" * 3000)


def nested(depth: int) -> Any:
    """A list in a list in a list."""
    value: Any = 1
    for _ in range(depth):
        value = [value]
    return value


odd_values: st.SearchStrategy[Any] = st.one_of(
    st.sampled_from(ODD_NUMBERS),
    st.sampled_from((math.nan, math.inf, -math.inf)),
    st.booleans(),
    st.sampled_from(ODD_TEXTS),
    st.integers(),
    st.floats(),
    st.text(max_size=8),
    st.builds(list),
    st.builds(dict),
    st.sampled_from([1, 5, 60]).map(nested),
    st.lists(st.sampled_from(ODD_NUMBERS), min_size=1, max_size=4),
    st.lists(st.sampled_from(ODD_TEXTS), min_size=1, max_size=3),
    st.dictionaries(st.sampled_from(KEYS), st.sampled_from(ODD_NUMBERS), min_size=1, max_size=2),
)


def paths(content: Any, above: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Where every value of nested plain values stands."""
    here = [above] if above else []
    children = content.items() if isinstance(content, dict) else enumerate(content) if isinstance(content, list) else ()
    return [*here, *(path for key, value in children for path in paths(value, (*above, key)))]


@st.composite
def changed(draw: st.DrawFn, content: dict[str, Any], most: int = 3) -> dict[str, Any]:
    """Plain values with up to `most` of them replaced, left out, or joined by unknown keys, at any level."""
    result = copy.deepcopy(content)
    for _ in range(draw(st.integers(1, most))):
        where = paths(result)
        if not where:
            break
        *above, key = draw(st.sampled_from(where))
        place = result
        for step in above:
            place = place[step]
        match draw(st.sampled_from(["replace", "replace", "number", "number", "drop", "add"])):
            case "replace":
                place[key] = draw(odd_values)
            case "number" if isinstance(place[key], int | float) and not isinstance(place[key], bool):
                place[key] = place[key] * draw(st.sampled_from([-1, 0, 0.1, 0.5, 2, 3, 1000, 10**12, math.inf]))
            case "drop" if isinstance(place, dict):
                del place[key]
            case _ if isinstance(place, dict):
                place[draw(st.sampled_from(KEYS))] = draw(odd_values)
            case _:
                place[key] = draw(odd_values)
    return result


def toml(content: Any) -> str:
    """Plain values as TOML; a key of the top level a line, tables below it inline. None is left out."""
    return "".join(f"{_text(key)} = {_value(value)}\n" for key, value in content.items() if value is not None)


def _value(value: Any) -> str:
    match value:
        case dict():
            inside = ", ".join(f"{_text(key)} = {_value(each)}" for key, each in value.items() if each is not None)
            return f"{{ {inside} }}"
        case list() | tuple():
            return f"[{', '.join(_value(each) for each in value if each is not None)}]"
        case str():
            return _text(value)
        case bool() | int():
            return str(value).lower()
        case float() if math.isfinite(value):
            return repr(value)
    return str(value)  # nan, inf, -inf


def _text(value: str) -> str:
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")


@st.composite
def garbled(draw: st.DrawFn, content: bytes) -> bytes:
    """A file's bytes with a few changes: cut, flipped, doubled, or with something put in."""
    for _ in range(draw(st.integers(1, 3))):
        at = draw(st.integers(0, len(content)))
        end = min(len(content), at + draw(st.sampled_from([1, 4, 40, 4000])))
        inserted = draw(st.one_of(st.binary(max_size=6), st.sampled_from(INSERTED)))
        match draw(st.sampled_from(["cut", "flip", "double", "insert", "replace", "remove"])):
            case "cut":
                content = content[:at]
            case "flip" if at < len(content):
                content = content[:at] + bytes([content[at] ^ (1 << draw(st.integers(0, 7)))]) + content[at + 1 :]
            case "double":
                content = content[:end] + content[at:]
            case "replace":
                content = content[:at] + inserted + content[end:]
            case "remove":
                content = content[:at] + content[end:]
            case _:
                content = content[:at] + inserted + content[at:]
    return content


@st.composite
def attribute_changed(draw: st.DrawFn, content: bytes) -> bytes:
    """An XML file with some of its attributes' values replaced."""
    parts = content.decode().split('"')
    for _ in range(draw(st.integers(1, 3))):
        values = range(1, len(parts) - 1, 2)
        if not values:
            break
        parts[draw(st.sampled_from(values))] = draw(st.sampled_from(ATTRIBUTES))
    return '"'.join(parts).encode()


@dataclass(frozen=True)
class Spoilt:
    """A file of the folder that every case has, and what becomes of it; None: it is a folder instead."""

    file: str
    content: bytes | None
    linked: bool = False

    def apply(self, folder: Path) -> None:
        path = folder / self.file
        path.unlink()
        if self.linked:
            path.symlink_to(path)
        elif self.content is None:
            path.mkdir()
        else:
            path.write_bytes(self.content)


def spoilt(file: str, content: bytes, changes: st.SearchStrategy[bytes]) -> st.SearchStrategy[Spoilt]:
    """A file changed a little (mostly), or replaced: by nothing, noise, a folder, a link to itself."""
    return st.one_of(
        st.builds(Spoilt, st.just(file), st.one_of(changes, changes, garbled(content), st.sampled_from(REPLACED))),
        st.sampled_from([Spoilt(file, None), Spoilt(file, None, linked=True)]),
    )
