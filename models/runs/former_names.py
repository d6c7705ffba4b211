"""Pre-onset windows were called preludes: studies, runs and results of then open under today's names."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

from pydantic import BeforeValidator

SECTION, FORMER_SECTION = "pre_onset", "preludes"
"""The section of the training settings."""
SCORE, FORMER_SCORE = "pre_onset", "prelude"
"""The open-set score."""
FILE, FORMER_FILE = "pre_onset.skops", "preludes.skops"
"""The file in a run's folder."""


def present_score(name: Any) -> Any:
    """Return the present name of an open-set score."""
    return SCORE if name == FORMER_SCORE else name


OpenSetScore = Annotated[str, BeforeValidator(present_score)]
"""The name of an open-set score, as a key or a value of what is stored."""


def present_settings(training: Mapping[str, Any]) -> dict[str, Any]:
    """Return training settings under present names. Raises ValueError if they have a section under both names."""
    if FORMER_SECTION not in training:
        return dict(training)
    if SECTION in training:
        raise ValueError(f"{FORMER_SECTION}: is the former name of {SECTION}, which is given, too; remove one of them")
    return {SECTION if key == FORMER_SECTION else key: value for key, value in training.items()}


def present_file(folder: Path) -> Path:
    """Return the file of the reject option in a run's folder, which there may be none of."""
    former = folder / FORMER_FILE
    return former if former.is_file() and not (folder / FILE).is_file() else folder / FILE
