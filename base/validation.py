"""Says in our own words what is wrong with a settings object's values, on one line.

pydantic finds the fault. Its own text speaks of its types and of how it parses, which does not help the author of a
study file.
"""

from __future__ import annotations

import re
import reprlib
from collections.abc import Iterable, Mapping
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError

from isac_cosim.base.registry import nearest

KINDS = {
    "bool": "true or false",
    "dict": "a table of keys and values",
    "float": "a number",
    "int": "a whole number",
    "list": "a list",
    "model": "a table of keys and values",
    "string": "text",
    "tuple": "a list",
}
"""Kinds of values by the beginning of pydantic's error types, `int_type` or `int_parsing`."""
BOUNDS = {
    "greater_than": ("gt", "more than"),
    "greater_than_equal": ("ge", "at least"),
    "less_than": ("lt", "less than"),
    "less_than_equal": ("le", "at most"),
}
"""Bounds of numbers by pydantic's error type: where the error keeps the bound, and how it reads."""
LENGTHS = {
    "string_too_long": ("max_length", "at most", "characters"),
    "string_too_short": ("min_length", "at least", "characters"),
    "too_long": ("max_length", "at most", "entries"),
    "too_short": ("min_length", "at least", "entries"),
}
"""Bounds of lengths by pydantic's error type: where the error keeps the bound, how it reads, and what is counted."""
MOST_CHOICES = 12
"""A longer list of choices is not written out."""


def first_fault(error: ValidationError, model: type[BaseModel]) -> str:
    """Return the first fault of a validation as one line: the key's path, what is wrong, and the value.

    model: the class that was validated; its fields are the keys that a misspelt one is compared with.
    """
    fault = error.errors(include_url=False)[0]
    problem = _problem(fault, model)
    path = ".".join(map(str, fault["loc"]))
    return " ".join(f"{path}: {problem}".split()) if path else problem


def _problem(fault: Mapping[str, Any], model: type[BaseModel]) -> str:
    """Return what is wrong, without the key's path."""
    kind, context = fault["type"], fault.get("ctx", {})
    if kind in ("value_error", "assertion_error"):
        # Raised by a validator of ours, in our own words.
        return str(context["error"])
    if kind == "json_invalid":
        return "is not valid JSON"
    if kind == "missing":
        return "is missing; give it a value"
    if kind == "extra_forbidden":
        parents = filter(_is_model, _alternatives(_annotation_at(model, fault["loc"][:-1])))
        known = [name for parent in parents for name in _keys_of(parent)]
        return f"unknown key; {_nearest(fault['loc'][-1], known) or 'remove it or fix its spelling'}"
    if kind == "literal_error":
        annotation = _annotation_at(model, fault["loc"])
        choices = [str(choice) for part in _alternatives(annotation) for choice in get_args(part)]
        return f"unknown value {reprlib.repr(fault['input'])}; {_choose(fault['input'], choices)}"
    return f"must {_requirement(kind, context, _annotation_at(model, fault['loc']))}{_value(fault['input'])}"


def _requirement(kind: str, context: Mapping[str, Any], annotation: Any) -> str:
    """Return what a value must be or have: its kind, a bound, a length or a pattern."""
    if kind == "finite_number":
        return "be a finite number"
    if kind == "string_pattern_mismatch":
        return f"match the pattern {context['pattern']}"
    if kind in BOUNDS:
        name, words = BOUNDS[kind]
        return f"be {words} {_plain(context[name])}"
    if kind in LENGTHS:
        name, words, counted = LENGTHS[kind]
        number = context[name]
        return f"have {words} {number} {counted if number != 1 else {'entries': 'entry'}.get(counted, 'character')}"
    return f"be {KINDS.get(kind.partition('_')[0]) or _kind_of(annotation)}"


def _kind_of(annotation: Any) -> str:
    """Return what kind of value an annotation stands for."""
    alternatives = _alternatives(annotation)
    if len(alternatives) > 1:
        return " or ".join(map(_kind_of, alternatives))
    annotation = alternatives[0]
    if _is_model(annotation):
        return KINDS["model"]
    origin = get_origin(annotation) or annotation
    if origin is Literal:
        return f"one of {', '.join(map(str, get_args(annotation)))}"
    names = {bool: "bool", dict: "dict", float: "float", int: "int", list: "list", str: "string", tuple: "tuple"}
    return KINDS[names[origin]] if origin in names else "another kind of value"


def _annotation_at(annotation: Any, location: tuple[int | str, ...]) -> Any:
    """Return the annotation of the value at a location within a settings class, None where there is none."""
    if not location:
        return annotation
    for part in _alternatives(annotation):
        if _is_model(part):
            return _annotation_at(_keys_of(part).get(str(location[0])), location[1:])
        if get_origin(part) in (dict, list, tuple):
            # All entries of our lists are of one kind; a dictionary names the kind of its values after its keys'.
            entry = get_args(part)[1 if get_origin(part) is dict else 0]
            return _annotation_at(entry, location[1:])
    return None


def _keys_of(model: type[BaseModel]) -> dict[str, Any]:
    """Return the annotation of each key that a settings class may have: its fields, and the sections it knows of."""
    fields = {name: field.annotation for name, field in model.model_fields.items()}
    return {**fields, **getattr(model, "known_sections", dict)()}


def _alternatives(annotation: Any) -> tuple[Any, ...]:
    """Return what an annotation allows besides None, without annotations of annotations."""
    if get_origin(annotation) is Annotated:
        return _alternatives(get_args(annotation)[0])
    if get_origin(annotation) in (Union, UnionType):
        return tuple(part for part in get_args(annotation) if part is not NoneType)
    return (annotation,)


def _plain(number: float) -> str:
    """Return a bound without a needless decimal point."""
    return str(int(number)) if float(number).is_integer() else str(number)


def _is_model(annotation: Any) -> bool:
    return isinstance(annotation, type) and issubclass(annotation, BaseModel)


def _choose(value: object, choices: list[str]) -> str:
    """Return the advice which of the choices to take: the nearest, or all of them."""
    if suggestion := _nearest(value, choices):
        return suggestion
    if len(choices) == 1:
        return f"only {choices[0]} is possible"
    return f"choose one of {', '.join(choices[:MOST_CHOICES])}{', ...' if len(choices) > MOST_CHOICES else ''}"


def _nearest(word: object, known: Iterable[str]) -> str | None:
    """Return the advice to take the known word that is spelt most like the given one, None if all are far from it."""
    return nearest(str(word), known).strip() or None


def _value(value: object) -> str:
    """Return the wrong value, short, or nothing where it is a whole table."""
    return "" if isinstance(value, dict) else f", not {re.sub(r'0x[0-9a-f]+', '...', reprlib.repr(value))}"
