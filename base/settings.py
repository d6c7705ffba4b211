"""The base of all settings objects, and how they are read from plain values, TOML files and JSON files."""

from __future__ import annotations

import json
import tomllib
from codecs import BOM_UTF16_BE, BOM_UTF16_LE
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, ClassVar, TypeVar

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    SerializerFunctionWrapHandler,
    ValidationError,
    model_serializer,
)

from isac_cosim.base.errors import InputError
from isac_cosim.base.files import DIGEST, content_digest, write_json
from isac_cosim.base.validation import first_fault

MOST_BYTES = 100_000
"""Largest size of a study file."""
FORGOTTEN = ("0.1.0",)
"""Versions of the tool whose files are read no longer."""


class Settings(BaseModel):
    """A section of a study: immutable, with units in the field names.

    Unknown keys and numbers that are not finite are refused.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    @classmethod
    def known_sections(cls) -> Mapping[str, type[Settings]]:
        """Return the sections that this one may have besides its fields, for messages about wrong keys."""
        return {}


class WithOptionalParts(Settings):
    """Settings some parts of which are absent from what is stored, rather than null, where they do not apply.

    What was stored before there was such a part thus stays as it was, to its digest.
    """

    optional_parts: ClassVar[frozenset[str]] = frozenset()

    @model_serializer(mode="wrap")
    def _leave_out_absent_parts(self, serialize: SerializerFunctionWrapHandler) -> dict[str, Any]:
        content: dict[str, Any] = serialize(self)
        return {key: value for key, value in content.items() if value is not None or key not in self.optional_parts}


class Sealed(Settings):
    """Settings whose file holds a digest of its own content, so that a change to the file is noticed.

    sha256: digest of everything else in the file; None before the file is written, and in files of earlier versions.
    sealed_since: the schema version from which on a file must have one.
    """

    sealed_since: ClassVar[int]

    schema_version: int
    sha256: str | None = Field(None, pattern=DIGEST)

    def sealed(self) -> dict[str, Any]:
        """Return the content of the file, plain values with their digest."""
        content = self.model_dump(mode="json", exclude={"sha256"})
        return {**content, "sha256": content_digest(content)}


Section = TypeVar("Section", bound=Settings)


def checked(kind: type[Section], content: dict[str, Any], where: str | Path) -> Section:
    """Return settings made of plain values.

    where: the file or other place that the values come from. Raises InputError, which names that place and the path of
    the first wrong key.
    """
    try:
        return kind.model_validate(content)
    except ValidationError as error:
        raise InputError(f"{where}: {first_fault(error, kind)}") from None


def merged(content: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Return plain settings with some keys replaced, section by section."""
    result = dict(content)
    for key, value in changes.items():
        before = result.get(key)
        both = isinstance(value, Mapping) and isinstance(before, Mapping)
        result[key] = merged(before, value) if both else value  # type: ignore[arg-type]
    return result


def read_toml(path: Path) -> dict[str, Any]:
    """Return the content of a TOML file. Raises InputError if the file is missing, too large or not readable."""
    try:
        with path.open("rb") as file:
            content = file.read(MOST_BYTES + 1)
        if len(content) > MOST_BYTES:
            raise InputError(f"{path}: has more than {MOST_BYTES} bytes, too many for a study; give a study file")
        if content.startswith((BOM_UTF16_LE, BOM_UTF16_BE)):
            raise InputError(f"{path}: is in UTF-16, and TOML is in UTF-8; save the file as UTF-8")
        # Editors on Windows put this mark before a file in UTF-8.
        return tomllib.loads(content.decode("utf-8-sig"))
    except FileNotFoundError:
        raise InputError(f"{path}: no such study file; give the path of a .toml file") from None
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError, RecursionError) as error:
        raise InputError(f"{path}: not a readable TOML file ({' '.join(str(error).split())})") from None


def read_json(kind: type[Section], path: Path) -> Section | None:
    """Return the settings in a JSON file that the tool wrote, or None if there is no such file.

    Raises InputError if the file cannot be read, is damaged or was changed, or if its version is read no longer.
    """
    try:
        stored = path.read_bytes()
        _check_version(stored, path)
        content = kind.model_validate_json(stored)
        if isinstance(content, Sealed):
            _check_seal(content, stored, path)
        return content
    except (FileNotFoundError, NotADirectoryError):
        return None
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); make it readable") from None
    except ValidationError as error:
        fault = first_fault(error, kind)
        raise InputError(f"{path}: {fault}; the file is damaged or was written by another version") from None


def write_sealed(path: Path, content: Sealed) -> None:
    """Write settings with their digest, completely or not at all. Raises OutputError."""
    write_json(path, content.sealed())


def _check_version(stored: bytes, path: Path) -> None:
    """Raise InputError if a file says that it is of a version that is read no longer."""
    version: Any = None
    with suppress(AttributeError, KeyError, RecursionError, TypeError, ValueError):
        content = json.loads(stored)
        version = content.get("made_by", content)["versions"]["isac-cosim"]
    if version in FORGOTTEN:
        raise InputError(f"{path}: was written by version {version}, which is read no longer; make it anew")


def _check_seal(content: Sealed, stored: bytes, path: Path) -> None:
    """Raise InputError if a file differs from its own digest, or lacks one that it should have."""
    if content.sha256 is None:
        if content.schema_version >= content.sealed_since:
            raise InputError(f"{path}: sha256: is missing; the file was changed: restore it, or make it again")
        return
    try:
        values = json.loads(stored)
        del values["sha256"]
        unchanged = content_digest(values) == content.sha256
    except (RecursionError, ValueError):
        unchanged = False
    if not unchanged:
        raise InputError(
            f"{path}: sha256: differs from the content; the file was changed: restore it, or make it again"
        )
