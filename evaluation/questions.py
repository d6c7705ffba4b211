"""What result parts of other packages measure beside the tool's own metrics.

A package offers a result part under the entry point group GROUP. If it has a method `measure`, it is asked when an
evaluation is done, and its answer is kept in `metrics.json` under `answers`, by the part's name.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Protocol, TypeVar, runtime_checkable

from pydantic import JsonValue

from isac_cosim.base.errors import InputError
from isac_cosim.base.registry import Registry
from isac_cosim.base.settings import Settings

GROUP = "isac_cosim.result_parts"
"""The entry point group through which installed packages offer result parts."""


@runtime_checkable
class Question(Protocol):
    """A result part that measures something of its own."""

    @property
    def result_class(self) -> type:
        """The class of the results that it is asked of, such as `EvaluationResult` or `TrafficResult`."""

    def measure(self, evaluation: Any) -> Settings | None:
        """Return the answer, or None where there is none.

        evaluation: `on_windows.evaluation.Evaluation` or `in_traffic.measurement.summary.TrafficEvaluation`, with the
        predictions or answers behind its result.
        """


Measured = TypeVar("Measured", bound=Any)
OFFERED: Registry[Any] = Registry("result part", {}, GROUP)
"""The result parts of installed packages."""


def answers(evaluation: Any) -> dict[str, JsonValue]:
    """Return the answers of installed result parts to an evaluation, as plain values, by the part's name.

    Raises InputError, which names the part, where one fails.
    """
    given: dict[str, JsonValue] = {}
    for name, part in OFFERED.items():
        if not isinstance(part, Question) or not isinstance(evaluation.result, part.result_class):
            continue
        try:
            answer = part.measure(evaluation)
        except Exception as error:
            raise InputError(f"result part {name}: {type(error).__name__}: {error}; fix or uninstall it") from error
        if answer is not None:
            given[name] = answer.model_dump(mode="json")
    return given


def with_answers(evaluation: Measured) -> Measured:
    """Return an evaluation whose result holds the answers of installed result parts, where there are any.

    Raises InputError, which names the part, where one fails.
    """
    given = answers(evaluation)
    return replace(evaluation, result=evaluation.result.model_copy(update={"answers": given})) if given else evaluation
