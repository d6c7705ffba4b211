"""What the files of stages hold, and what all of them have in common: a digest, and whose they are."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from isac_cosim.base.files import DIGEST
from isac_cosim.base.settings import Sealed, Settings
from isac_cosim.evaluation.statistics import Counts

MOST = 10**9
"""No stage counts more of anything."""
Count = Annotated[int, Field(ge=0, le=MOST)]


class StageResult(Sealed):
    """What a stage measured.

    schema_version: 1 in files of version 0.2, which have no digest and do not say whose they are. stage: its name.
    reproduction: digest of the `reproduction.json` beside it.
    """

    sealed_since: ClassVar[int] = 2

    schema_version: Literal[1, 2] = 1
    stage: str | None = None
    reproduction: str | None = Field(None, pattern=DIGEST)


class DatasetFacts(Settings):
    """What a stage's file says of a dataset.

    median_position_error_m: median over the records of the median distance of a record's filtered positions from the
    true ones, m; None where there are no records.
    """

    digest: str
    samples: Count
    by_intention: dict[str, Count]
    left_out: dict[str, Count]
    median_position_error_m: float | None


def is_square(counts: Counts) -> bool:
    """Return whether counts are those of a confusion matrix."""
    return bool(counts) and all(len(row) == len(counts) and min(row) >= 0 and max(row) <= MOST for row in counts)
