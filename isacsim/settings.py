"""The base of every settings object: typed, frozen, closed; and how one is read back from a JSON file."""

from pathlib import Path
from typing import TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError

from isacsim.errors import InputError


class Settings(BaseModel):
    """A section of a study: immutable, unknown keys and endless numbers refused, units in the field names."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


Stored = TypeVar("Stored", bound=Settings)


def read_json(kind: type[Stored], path: Path) -> Stored | None:
    """What a JSON file that the tool wrote holds, or None where there is none.

    Raises InputError where it cannot be read, is damaged or of another version.
    """
    try:
        return kind.model_validate_json(path.read_bytes())
    except (FileNotFoundError, NotADirectoryError):
        return None
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); mend that") from None
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        where = ".".join(map(str, first["loc"])) or "the file"
        raise InputError(f"{path}: {where}: {first['msg']}; it was damaged or made by another version") from None
