"""What only people can state of a dataset: its licence, how to cite it, who made it, where it is."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from pydantic import Field, StringConstraints

from isac_cosim.base.settings import Settings, read_json

STATEMENT_FILE = "publication.json"
Line = Annotated[str, StringConstraints(pattern=r"^[^\x00-\x1f\x7f]*\S[^\x00-\x1f\x7f]*$", max_length=1000)]


class Statement(Settings):
    """The content of `publication.json`. What nobody has stated is None."""

    license: Line | None = Field(None, description="licence: an SPDX identifier such as CC-BY-4.0, or a URL")
    citation: Line | None = Field(None, description="how to cite the dataset")
    creator: Line | None = Field(None, description="who made it")
    url: Annotated[str, StringConstraints(pattern=r"^https?://\S+$", max_length=1000)] | None = Field(
        None, description="where it is published"
    )


def read_statement(folder: Path) -> Statement:
    """Return what a dataset's folder states. Raises InputError if the file is damaged."""
    return read_json(Statement, folder / STATEMENT_FILE) or Statement()
