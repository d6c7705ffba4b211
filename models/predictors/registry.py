"""All predictors by name: those of this project, and those that installed packages offer."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

from pydantic import BaseModel, create_model

from isac_cosim.base.registry import Registry
from isac_cosim.base.settings import Settings
from isac_cosim.models.predictors.aligned import AlignedPredictor
from isac_cosim.models.predictors.asi_bip import (
    AsiBipPredictor,
    FastPredictor,
    RecentPredictor,
    SlowPredictor,
    TvAlonePredictor,
    UvAlonePredictor,
)
from isac_cosim.models.predictors.castformer import CastformerPredictor
from isac_cosim.models.predictors.embedding_trees import EmbeddingTreesPredictor
from isac_cosim.models.predictors.ensemble import EnsemblePredictor
from isac_cosim.models.predictors.inception_time import InceptionTimePredictor
from isac_cosim.models.predictors.minirocket import MinirocketPredictor
from isac_cosim.models.predictors.multirocket_hydra import MultirocketHydraPredictor
from isac_cosim.models.predictors.protocol import AskedPredictor, Predictor
from isac_cosim.models.predictors.rule import RulePredictor
from isac_cosim.models.predictors.trees import TreesPredictor

GROUP = "isac_cosim.predictors"
"""The entry point group through which installed packages offer predictors."""
OWN: Mapping[str, type[Predictor]] = {
    "asi-bip": AsiBipPredictor,
    "tv-alone": TvAlonePredictor,
    "asi-bip-recent": RecentPredictor,
    "asi-bip-slow": SlowPredictor,
    "asi-bip-fast": FastPredictor,
    "uv-alone": UvAlonePredictor,
    "aligned": AlignedPredictor,
    "castformer": CastformerPredictor,
    "ensemble": EnsemblePredictor,
    "trees": TreesPredictor,
    "embedding-trees": EmbeddingTreesPredictor,
    "inception-time": InceptionTimePredictor,
    "rule": RulePredictor,
    "minirocket": MinirocketPredictor,
    "multirocket-hydra": MultirocketHydraPredictor,
}
"""The predictors of this project."""
ASKED = "function"
"""The name, in results, of a function that was evaluated in the place of a predictor. Nobody is offered it."""
PREDICTORS: Registry[type[Predictor]] = Registry("predictor", OWN, GROUP, {ASKED: AskedPredictor})


def section_name(name: str) -> str:
    """Return the name of a predictor's section in study files and cards."""
    return name.replace("-", "_")


def sections(*names: str) -> dict[str, type[Settings]]:
    """Return the settings classes by section: those of this project's predictors, then those of the predictors named.

    Predictors with the same settings class share the section of the first one.
    """
    by_class: dict[type[Settings], str] = {}
    for name in dict.fromkeys([*OWN, *names]):
        settings_class = PREDICTORS[name].settings_class
        if settings_class is not None:
            by_class.setdefault(settings_class, section_name(name))
    return {section: settings_class for settings_class, section in by_class.items()}


def checked_sections(content: Mapping[str, object], model: str) -> dict[str, Settings]:
    """Return the sections of this project's predictors, of `model`, and of those that `content` has a section of.

    content: sections as plain values or settings objects, by name; what is absent has its defaults.
    Raises ValidationError where a section is unknown or its content is wrong, located at the key.
    """
    with_section = [name for name in PREDICTORS if section_name(name) in content]
    model_of_sections = _model_of(tuple(sections(*with_section, model).items()))
    return dict(model_of_sections.model_validate(dict(content)))


def catalogue() -> str:
    """Return a line per predictor of this project, name and summary, for help texts."""
    width = max(map(len, OWN))
    return "\n".join(f"{name:{width}}  {kind.summary}" for name, kind in OWN.items())


@cache
def _model_of(fields: tuple[tuple[str, type[Settings]], ...]) -> type[BaseModel]:
    """Return a settings class with a field for each section; unknown sections are refused."""
    # The annotation of a created model is that of any model; its fields are not known statically.
    return create_model("Sections", __base__=Settings, **{name: (kind, kind()) for name, kind in fields})  # type: ignore[call-overload,no-any-return]
