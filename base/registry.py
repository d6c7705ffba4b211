"""Named implementations of a Protocol: those of this project, and those that other packages offer as entry points."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from difflib import get_close_matches
from functools import cached_property
from importlib.metadata import EntryPoint, entry_points
from typing import Generic, TypeVar

from isac_cosim.base.errors import InputError

Item = TypeVar("Item")


def nearest(name: str, known: Iterable[str]) -> str:
    """Return the question whether the known name spelt most like this one was meant; "" if none is like it."""
    near = get_close_matches(name[:100], list(known), n=1)
    return f"did you mean {near[0]}? " if near else ""


class Registry(Mapping[str, Item], Generic[Item]):
    """A read-only mapping from names to implementations, in the order in which they are listed to users.

    kind: what the implementations are, in the singular, for error messages: "estimator". items: those of this project.
    group: the entry point group through which installed packages offer more; their names follow, sorted. A name of this
    project cannot be replaced. An offered implementation is imported when it is first looked up, not before. unlisted:
    names that are looked up but not listed, of what results may name and users cannot choose.
    """

    def __init__(
        self,
        kind: str,
        items: Mapping[str, Item],
        group: str | None = None,
        unlisted: Mapping[str, Item] | None = None,
    ) -> None:
        self.kind = kind
        self._items = dict(items)
        self._group = group
        self._unlisted = dict(unlisted or {})

    def __getitem__(self, name: str) -> Item:
        """Return an implementation. Raises InputError for an unknown name, or one that cannot be imported."""
        if name in self._items:
            return self._items[name]
        if name in self._unlisted:
            return self._unlisted[name]
        if name not in self._offered:
            raise InputError(self.unknown(name))
        entry_point = self._offered[name]
        try:
            item: Item = entry_point.load()
        except Exception as error:
            package = entry_point.dist.name if entry_point.dist else entry_point.value
            raise InputError(
                f"{self.kind} {name}: package {package} cannot be imported ({error}); fix or uninstall it"
            ) from None
        self._items[name] = item
        return item

    def __iter__(self) -> Iterator[str]:
        return iter(dict.fromkeys([*self._items, *self._offered]))

    def __len__(self) -> int:
        return len(self._items.keys() | self._offered.keys())

    def __contains__(self, name: object) -> bool:
        return name in self._items or name in self._unlisted or name in self._offered

    def package(self, name: str) -> str | None:
        """Return the name of the installed package that offers an implementation; None for those of this project."""
        point = self._offered.get(name)
        return point.dist.name if point is not None and point.dist is not None else None

    def check(self, name: str) -> str:
        """Return a name that is registered; a validator for pydantic. Raises ValueError, which names the nearest."""
        if name not in self:
            raise ValueError(self.unknown(name))
        return name

    def unknown(self, name: str) -> str:
        """Return the message for an unknown name: the nearest known one, and all of them."""
        return f"unknown {self.kind} {name!r}: {nearest(name, self)}choose one of {', '.join(self)}"

    @cached_property
    def _offered(self) -> dict[str, EntryPoint]:
        points = entry_points(group=self._group) if self._group else ()
        return {point.name: point for point in sorted(points, key=lambda point: point.name)}
