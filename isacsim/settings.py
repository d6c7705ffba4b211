"""The base of every settings object: typed, frozen, closed."""

from pydantic import BaseModel, ConfigDict


class Settings(BaseModel):
    """A section of a study: immutable, unknown keys refused, units in the field names."""

    model_config = ConfigDict(frozen=True, extra="forbid")
