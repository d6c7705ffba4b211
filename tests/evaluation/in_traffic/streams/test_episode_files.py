"""Files of episodes: what is read is what was written, and a file that is none is refused in a line."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

from isac_cosim.base.errors import InputError
from isac_cosim.base.settings import Settings
from isac_cosim.base.stored.episode_files import EpisodeFiles, named_column, names_and_numbers


class Facts(Settings):
    """What a file says of its episode."""

    seed: int


def check(table: pa.Table) -> None:
    if table.column_names[0] != "tv":
        raise ValueError("tv: is missing")


FILES = EpisodeFiles(Facts, b"test", lambda facts: [f"road-{facts.seed}.parquet"], check)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    path = tmp_path / "road-3.parquet"
    FILES.write(
        path, Facts(seed=3), {"tv": named_column(np.array([1, 0, 1]), ("a", "b")), "x": pa.array([1.0, 2.0, 3.0])}
    )
    return path  # fmt: skip


def test_a_file_holds_what_was_written(path: Path) -> None:
    facts, table = FILES.read(path)
    names, numbers = names_and_numbers(table["tv"])
    assert facts == FILES.read_facts(path) == Facts(seed=3)
    assert [names[number] for number in numbers] == ["b", "a", "b"]
    assert table["x"].to_pylist() == [1.0, 2.0, 3.0]
    assert FILES.read(path, lambda column: column != "x")[1].column_names == ["tv"]


@pytest.mark.parametrize(
    ("damage", "reason"),
    [
        (lambda path: path.rename(path.with_name("road-4.parquet")), "it is road-3.parquet, renamed"),
        (lambda path: path.write_bytes(path.read_bytes()[:-20]) and path, "it has no facts of an episode"),
        (lambda path: path.with_name("road-5.parquet"), "it has no facts of an episode"),
    ],
)
def test_another_file_is_refused(path: Path, damage: Callable[[Path], Path], reason: str) -> None:
    with pytest.raises(InputError, match=f"not a complete episode \\({reason}\\); delete it and run"):
        FILES.read(damage(path) or path)


def test_an_episode_that_lacks_a_column_is_refused(tmp_path: Path) -> None:
    FILES.write(tmp_path / "road-1.parquet", Facts(seed=1), {"x": pa.array([1.0])})
    with pytest.raises(InputError, match="tv: is missing"):
        FILES.read(tmp_path / "road-1.parquet")
