"""Names of scenarios: they become parts of the names of files, so that not every name will do."""

from __future__ import annotations

import unicodedata
from pathlib import Path
from typing import Annotated

from pydantic import Field, TypeAdapter, ValidationError

from isac_cosim.base.errors import InputError

NAME = r"^[\pL\pN_](?:[\pL\pM\pN_ .-]*[\pL\pM\pN_-])?$"
"""Letters of any script, digits and underscores; inside also blanks, dots and hyphens. No name leads out of a folder.
In the syntax of pydantic and of Arrow, where `\\pL` is any letter, `\\pM` an accent and `\\pN` a digit."""
LONGEST_BYTES = 150
"""In UTF-8. The names of files, which seeds and endings are added to, may have 255."""
_NAMES: TypeAdapter[str] = TypeAdapter(Annotated[str, Field(pattern=NAME)])


def name_of(path: Path) -> str:
    """Return the name of a folder, composed letter by letter, so that it is the same on every system."""
    return unicodedata.normalize("NFC", path.resolve().name)


def check_name(name: str, where: object) -> None:
    """Raise InputError where a name cannot be a scenario's. where: what has that name."""
    try:
        _NAMES.validate_python(name)
    except ValidationError:
        raise InputError(
            f"{where}: the scenario's name {name!r} cannot be part of a file name: rename the folder or configuration; "
            "letters, digits, '_', and inside also blanks, '-' and '.' will do"
        ) from None
    if len(name.encode()) > LONGEST_BYTES:
        raise InputError(f"{where}: the scenario's name is longer than {LONGEST_BYTES} bytes: shorten it")
