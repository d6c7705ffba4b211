"""Help texts: examples, and what only the packages know, such as the registered choices and the default settings."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any, NoReturn

from typer.core import TyperArgument, TyperCommand, TyperOption

from isac_cosim.base.errors import InputError

NO_COMMAND = (
    "name a command: `cosim run` runs the quick study and writes its report into results/quick, "
    "`cosim generate motorway -o data --samples 500` makes a dataset, and `cosim --help` lists all commands"
)
"""What is said where no command is given."""


def examples(*lines: str) -> str:
    """Return the epilog of a command's help: how it is used, one line each, without the leading `cosim`."""
    return "Examples:\n\n" + "\n\n".join(f"`cosim {line}`" for line in lines)


class HelpfulCommand(TyperCommand):
    """A command whose help may name what is registered: `{predictors}` in a help text becomes their names.

    The packages are imported only when help is asked for.
    """

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the arguments. Raises InputError for one that is given as an empty text."""
        given, _, _ = self.make_parser(ctx).parse_args(args=list(args))
        rest: list[str] = super().parse_args(ctx, args)
        for parameter in self.params:
            value = given.get(str(parameter.name))
            texts = value if isinstance(value, list | tuple) else [value]
            if any(isinstance(text, str) and not text.strip() for text in texts):
                _refuse_empty(parameter)
        return rest

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Fill in the placeholders and write the help."""
        for parameter in self.params:
            if isinstance(parameter, TyperOption | TyperArgument) and parameter.help:
                for name, lookup in PLACEHOLDERS.items():
                    if f"{{{name}}}" in parameter.help:
                        parameter.help = parameter.help.replace(f"{{{name}}}", lookup())
        super().format_help(ctx, formatter)


def _refuse_empty(parameter: Any) -> NoReturn:
    """Raise InputError for an option or argument whose value is an empty text."""
    if isinstance(parameter, TyperOption):
        name, advice = max(parameter.opts, key=len), "" if parameter.required else ", or leave it out"
    else:
        name, advice = parameter.metavar or parameter.name.upper(), ""
    raise InputError(f"{name}: is empty; give it a value{advice}")


def _default(settings: str, field: str) -> Callable[[], str]:
    """Return what looks up the default of a field of a settings class, given as `module:Class`."""
    return lambda: f"{_imported(settings).model_fields[field].default:g}"


def _registered(registry: str) -> Callable[[], str]:
    """Return what looks up the names of a registry, given as `module:REGISTRY`."""
    return lambda: ", ".join(_imported(registry))


def _imported(place: str) -> Any:
    """Return the object at `module:name`."""
    module, _, name = place.partition(":")
    return getattr(import_module(module), name)


PLACEHOLDERS: Mapping[str, Callable[[], str]] = {
    "benches": _registered("benchmarks:BENCHES"),
    "estimators": _registered("isac_cosim.isacsim.radio.estimators:ESTIMATORS"),
    "export_step_s": lambda: f"{_imported('isac_cosim.labeling.export.exporting:STEP_S'):g}",
    "fusion_methods": _registered("isac_cosim.isacsim.tracking.fusion_methods:FUSION_METHODS"),
    "height_m": _default("isac_cosim.isacsim.scenarios.site_placement:PlacementSettings", "height_m"),
    "motion_sources": _registered("isac_cosim.isacsim.traffic.sources.registry:MOTION_SOURCES"),
    "papers": _registered("isac_cosim.studies.reproduction.reproduce:PAPERS"),
    "predictor": lambda: str(_imported("isac_cosim.models:DEFAULT")),
    "predictors": _registered("isac_cosim.models.predictors.registry:PREDICTORS"),
    "stream_predictor": lambda: str(_imported("isac_cosim.models.hazards.registry:DEFAULT")),
    "stream_predictors": _registered("isac_cosim.models.hazards.registry:STREAM_PREDICTORS"),
    "sensors": _registered("isac_cosim.isacsim.sensing.sensors:SENSORS"),
    "set_back_m": _default("isac_cosim.isacsim.scenarios.site_placement:PlacementSettings", "set_back_m"),
    "spacing_m": _default("isac_cosim.isacsim.scenarios.site_placement:PlacementSettings", "spacing_m"),
    "vehicles": _default("isac_cosim.isacsim.scenarios.demand:DemandSettings", "vehicles"),
}
"""What the names in braces in help texts stand for."""
