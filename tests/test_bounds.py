"""Every number in a settings object has a lowest and a highest value: nonsense is refused before work begins."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Union, get_args, get_origin

import annotated_types
import pytest
from pydantic import BaseModel, WrapValidator
from pydantic.fields import FieldInfo

from isac_cosim.base.errors import InputError
from isac_cosim.evaluation.closed_loop.settings import ClosedLoopSettings
from isac_cosim.evaluation.in_traffic.settings import LiveStudy
from isac_cosim.isacsim.scenarios.demand import DemandSettings
from isac_cosim.isacsim.scenarios.site_placement import PlacementSettings
from isac_cosim.labeling.generation.resense import ResenseSettings
from isac_cosim.models.predictors.registry import sections
from isac_cosim.studies.clip_validation import ClipSettings
from isac_cosim.studies.study import Study, read_study

SETTINGS: list[type[BaseModel]] = [
    Study, LiveStudy, ClosedLoopSettings, ResenseSettings, PlacementSettings, DemandSettings, ClipSettings,
    *sections().values(),
]  # fmt: skip


def unbounded(annotation: Any, metadata: Sequence[Any], path: str) -> Iterator[str]:
    """Yield the paths of the numbers in an annotation that lack a lowest or a highest value."""
    metadata = [part for entry in metadata for part in (entry.metadata if isinstance(entry, FieldInfo) else [entry])]
    if any(isinstance(part, WrapValidator) and part.func.__qualname__.startswith("range_within.") for part in metadata):
        return
    if get_origin(annotation) is Annotated:
        inner, *more = get_args(annotation)
        yield from unbounded(inner, [*metadata, *more], path)
    elif get_origin(annotation) in (Union, UnionType):
        for part in get_args(annotation):
            if part is not NoneType:
                yield from unbounded(part, metadata, path)
    elif get_origin(annotation) in (tuple, list, dict):
        for part in get_args(annotation):
            if part is not Ellipsis:
                yield from unbounded(part, (), path)
    elif isinstance(annotation, type) and issubclass(annotation, BaseModel):
        for name, field in annotation.model_fields.items():
            yield from unbounded(field.annotation, field.metadata, f"{path}.{name}")
    elif annotation in (int, float):
        lowest = any(isinstance(part, annotated_types.Ge | annotated_types.Gt) for part in metadata)
        highest = any(isinstance(part, annotated_types.Le | annotated_types.Lt) for part in metadata)
        if not (lowest and highest):
            yield path


@pytest.mark.parametrize("settings", SETTINGS, ids=lambda settings: settings.__name__)
def test_every_number_has_a_lowest_and_a_highest_value(settings: type[BaseModel]) -> None:
    assert list(unbounded(settings, (), settings.__name__)) == []


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ("[training]\nseed = -1", "training.seed: must be at least 0, not -1"),
        (f"[training]\nseed = {2**32}", "training.seed: must be at most 4294967295"),
        ("[training.split]\nseed = -3", "training.split.seed: must be at least 0"),
        (f"[evaluation]\nseed = {2**40}", "evaluation.seed: must be at most 4294967295"),
        ("[dataset.traffic]\nrun_in_s = 1e300", "traffic.run_in_s: must be at most 1000000"),
        ("[dataset.traffic]\nstep_s = 1e-300", "traffic.step_s: must be at least 0.001"),
        ("[dataset.traffic]\nduration_s = 1e300", "traffic.duration_s: must be at most 1000000"),
        ("[dataset.selection]\nwindows = 100000000000000000000", "selection.windows: must be at most 1000000000"),
        ("[evaluation.window_end_curve]\nfirst_s = -1e12", "window_end_curve.first_s: must be at least -1000"),
        ("[evaluation.window_end_curve]\nstep_s = 1e-9", "window_end_curve.step_s: must be at least 0.001"),
        ("[training.windows]\nend_after_s = [0.5, 1e300]", "training.windows.end_after_s.1: must be at most 1000"),
        ("[training.optimiser]\nbetas = [0.9, 1.0]", "training.optimiser.betas.1: must be less than 1"),
    ],
)
def test_a_number_out_of_bounds_in_a_study_is_one_line(lines: str, message: str, tmp_path: Path) -> None:
    file = tmp_path / "study.toml"
    file.write_text(f'name = "s"\n{lines}\n')
    with pytest.raises(InputError) as error:
        read_study(file)
    assert message in str(error.value)
    assert "\n" not in str(error.value)
