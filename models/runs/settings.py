"""The `[training]` section of a study: the settings of a training with a section for each registered predictor."""

from __future__ import annotations

from typing import Any, Self

from pydantic import (
    ConfigDict,
    SerializerFunctionWrapHandler,
    ValidationInfo,
    field_validator,
    model_serializer,
    model_validator,
)

from isac_cosim.base.errors import InputError
from isac_cosim.models import DEFAULT
from isac_cosim.models.data.fit_settings import FitSettings, OptimiserSettings
from isac_cosim.models.hazards.registry import STREAM_PREDICTORS
from isac_cosim.models.hazards.settings import StreamFitSettings
from isac_cosim.models.predictors.protocol import Predictor
from isac_cosim.models.predictors.registry import PREDICTORS, checked_sections, sections
from isac_cosim.models.runs.former_names import present_settings

SECTIONS_AFTER = "validation_ends"
"""The key that the predictors' sections follow when the settings are written."""


class TrainSettings(FitSettings):
    """Everything that makes a training: the predictor, what it sees, and how it is trained.

    The section of a predictor is named after it, with `_` for `-`: `[training.asi_bip]`. Those of this project's
    predictors are always there; that of an installed package is there if it is given or its predictor is chosen.
    `of` returns a section by its class. An optimiser key that is not given has the predictor's own default, if it has
    one, or that of `OptimiserSettings`.

    streams: of a training on streams; None of one on records.
    """

    model_config = ConfigDict(extra="allow")

    streams: StreamFitSettings | None = None

    @field_validator("model")
    @classmethod
    def _is_registered(cls, name: str) -> str:
        return name if name in STREAM_PREDICTORS else PREDICTORS.check(name)

    @model_validator(mode="after")
    def _learns_from_these(self) -> Self:
        if self.streams is None and self.model not in PREDICTORS:
            raise ValueError(f"model {self.model}: is trained on streams; make them with `cosim generate --streams`")
        if self.streams is None:
            return self
        if self.model not in STREAM_PREDICTORS:
            names = ", ".join(STREAM_PREDICTORS)
            raise ValueError(f"model {self.model}: is not trained on streams; choose one of {names}")
        if self.held_out is not None:
            raise ValueError("held_out: applies to datasets of records, not to streams")
        return self

    @property
    def predictor_class(self) -> type[Predictor]:
        """The class of the predictor. Raises InputError if the package that offers it cannot be imported."""
        return PREDICTORS[self.model] if self.streams is None else STREAM_PREDICTORS[self.model]

    @model_validator(mode="before")
    @classmethod
    def _complete_sections(cls, content: Any) -> Any:
        """Check the predictors' sections, and fill in what is absent."""
        if not isinstance(content, dict):
            return content
        content = present_settings(content)
        fields = {key: value for key, value in content.items() if key in cls.model_fields}
        model = content.get("model", DEFAULT)
        if not isinstance(model, str) or (model not in PREDICTORS and model not in STREAM_PREDICTORS):
            return fields  # The check of `model` reports it.
        if fields.get("streams") is not None and model in STREAM_PREDICTORS:
            optimiser = fields.get("optimiser", {})
            if isinstance(optimiser, dict):
                fields["optimiser"] = {**STREAM_PREDICTORS[model].optimiser_defaults, **optimiser}
        if model not in PREDICTORS:
            model = DEFAULT  # What is trained on streams has its settings in the section `streams`.
        if clash := cls.model_fields.keys() & sections(model):
            raise InputError(
                f"predictor {model}: its section {min(clash)} is a key of [training]; rename the predictor"
            )
        others = {key: value for key, value in content.items() if key not in fields}
        return {**fields, **checked_sections(others, model)}

    @field_validator("optimiser")
    @classmethod
    def _with_defaults(cls, optimiser: OptimiserSettings, info: ValidationInfo) -> OptimiserSettings:
        """Return the optimiser settings with the predictor's defaults for the keys that are not given.

        Only the given keys count as set, so that `for_predictor` can put the defaults of another predictor in place.
        """
        if "model" not in info.data:
            return optimiser  # The check of `model` reports it.
        explicit = {key: getattr(optimiser, key) for key in optimiser.model_fields_set}
        model = info.data["model"]
        # Those of predictors on streams are filled in before (`_complete_sections`).
        defaults = PREDICTORS[model].optimiser_defaults if model in PREDICTORS else {}
        resolved = OptimiserSettings.model_validate({**defaults, **explicit})
        return OptimiserSettings.model_construct(_fields_set=set(explicit), **dict(resolved))

    @model_serializer(mode="wrap")
    def _in_order(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Write the sections among the other keys, where cards and studies have always had them."""
        content = handler(self)
        fields = list(type(self).model_fields)
        at = fields.index(SECTIONS_AFTER) + 1
        order = [*fields[:at], *(self.model_extra or {}), *fields[at:]]
        if self.streams is None:
            order.remove("streams")
        return {key: content[key] for key in order if key in content}

    def for_predictor(self, model: str, seed: int | None = None) -> Self:
        """Return the settings for another predictor, and another training seed if one is given.

        What the user did not set of the optimiser has the defaults of the new predictor.
        Raises InputError if it is not registered.
        """
        PREDICTORS[model]
        kept = type(self).model_fields.keys() | sections(model).keys()
        content = {key: value for key, value in self if key in kept}
        return type(self).model_validate({**content, "model": model, "seed": self.seed if seed is None else seed})
