"""Draws docs/architecture.md from the imports: the packages, the rooms in them, their order, and what each is for.

Run: python -m isac_cosim.benchmarks.findings.architecture
"""

from __future__ import annotations

import ast
from collections.abc import Iterator, Mapping
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

from isac_cosim.base.files import replace_file
from isac_cosim.benchmarks.findings.figures.plan import ROOT
from isac_cosim.evaluation.report.parts import markdown

NAME = "isac_cosim"
"""The name that every package is imported under."""
FLOORS = (
    "base", "isacsim", "sumo_nets", "labeling", "models", "evaluation", "studies", "benchmarks", "command_line", "cosim"
)  # fmt: skip
"""The packages from the lowest up; each may import only itself and what is below it."""
PAGE = ROOT / "docs" / "architecture.md"
TEXT = """# Architecture

`make architecture` draws this page from the imports and the packages' docstrings; a test says when it is out of date.

Everything is imported under one name, `isac_cosim`; the packages lie beside each other in the checkout. Imports run
downward only, and no room imports one that imports it (`tests/test_floors.py`). The page goes from the top down, and so
does each table: a room may import those below it in its folder. The command line, `cosim.py`, stands above all of them:
a command reads arguments, makes one call and shows the result.
"""


def module_of(path: Path) -> str:
    """Return a module's name without that of the project: `isacsim/radio/echo.py` -> `isacsim.radio.echo`."""
    return ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


def files() -> Iterator[Path]:
    """Yield every module of the project, tests left out."""
    yield ROOT / "cosim.py"
    for package in FLOORS[:-1]:
        yield from sorted((ROOT / package).rglob("*.py"))


@cache
def modules() -> Mapping[str, Path]:
    """Return the file of every module, by its name without that of the project."""
    return {module_of(path): path for path in files()}


@cache
def imports() -> Mapping[str, frozenset[str]]:
    """Return the project's modules that each of them imports, at its top level or inside a function."""
    return {module: frozenset(_imported(path)) for module, path in modules().items()}


def _imported(path: Path) -> set[str]:
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name.removeprefix(f"{NAME}.") for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            package = node.module.removeprefix(NAME).removeprefix(".")
            members = {f"{package}.{alias.name}".removeprefix(".") for alias in node.names}
            names |= {member if member in modules() else package for member in members}
    return {name for name in names if name in modules()}


def room_of(module: str, folder: Path) -> str | None:
    """Return the room of a folder that a module lies in; the files of the folder itself are a room of their own, ".".

    folder: its path from the checkout. None for a module that lies elsewhere, and for the folder's `__init__`, which
    may say what its rooms share.
    """
    path = modules()[module].relative_to(ROOT)
    if not path.is_relative_to(folder) or path == folder / "__init__.py":
        return None
    inside = path.relative_to(folder).parts
    return inside[0] if len(inside) > 1 else "."


def rooms(folder: Path) -> dict[str, set[str]]:
    """Return the rooms of a folder, with the other rooms of it that each imports."""
    graph: dict[str, set[str]] = {}
    for module, names in imports().items():
        if (room := room_of(module, folder)) is not None:
            others = {room_of(name, folder) for name in names}
            graph.setdefault(room, set()).update(other for other in others if other is not None and other != room)
    return graph


def drawn() -> str:
    """Return the text of the page."""
    parts = [TEXT]
    for package in reversed(FLOORS[:-1]):
        used = {name.split(".")[0] for module, names in imports().items() if _in(module, package) for name in names}
        rests = [f"`{other}`" for other in FLOORS if other in used - {package}]
        below = ", ".join(rests) if rests else "no other package"
        text = f"## {package}\n\n{purpose(Path(package))} It imports {below}.\n"
        if rows := list(_rows(Path(package))):
            text += f"\n{markdown(['room', 'what it is for', 'imports from beside it'], rows)}\n"
        parts.append(text)
    return "\n".join(parts)


def purpose(folder: Path) -> str:
    """Return the first paragraph of a package's docstring, in one line."""
    tree = ast.parse((ROOT / folder / "__init__.py").read_text(encoding="utf-8"))
    return " ".join((ast.get_docstring(tree) or "").split("\n\n")[0].split())


def _rows(folder: Path, depth: int = 0) -> Iterator[list[str]]:
    """Yield a row for each room of a folder, those on top first, and behind it those inside it."""
    graph = {room: sorted(others) for room, others in sorted(rooms(folder).items())}
    for room in reversed(list(TopologicalSorter(graph).static_order())):
        inside = folder / room
        if room != "." and (ROOT / inside / "__init__.py").is_file():
            name = inside.relative_to(inside.parts[0]).as_posix()
            beside = ", ".join("files of the folder" if other == "." else f"`{other}`" for other in graph[room])
            yield [f"{'&emsp;' * depth}`{name}`", purpose(inside), beside]
            yield from _rows(inside, depth + 1)


def _in(module: str, package: str) -> bool:
    return module.split(".")[0] == package


def main() -> None:
    """Write the page."""
    text = drawn()
    replace_file(PAGE, lambda partial: partial.write_text(text, encoding="utf-8"))


if __name__ == "__main__":
    main()
