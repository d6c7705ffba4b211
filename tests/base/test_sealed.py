"""Files with a digest of their own content: a change is noticed, whatever it is."""

from __future__ import annotations

import json
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, ClassVar

import pytest
from hypothesis import given
from hypothesis import strategies as st

from isac_cosim.base.errors import InputError
from isac_cosim.base.settings import Sealed, read_json, write_sealed

plain = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text(max_size=9),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=9,
)


class Card(Sealed):
    """A file that has a digest since its second schema."""

    sealed_since: ClassVar[int] = 2

    schema_version: int = 2
    content: Any = None


@given(plain, plain)
def test_a_file_is_read_back_and_any_change_is_noticed(content: Any, other: Any) -> None:
    with TemporaryDirectory() as folder:
        path = Path(folder) / "card.json"
        write_sealed(path, Card(content=content))
        read = read_json(Card, path)
        assert read is not None
        assert read.content == content
        changed = json.loads(path.read_text()) | {"content": other}
        path.write_text(json.dumps(changed))
        if json.dumps(other, sort_keys=True) == json.dumps(content, sort_keys=True):
            assert read_json(Card, path) is not None
        else:
            with pytest.raises(InputError, match=r"card\.json: sha256: differs from the content"):
                read_json(Card, path)


def test_another_layout_of_the_same_values_is_no_change(tmp_path: Path) -> None:
    path = tmp_path / "card.json"
    write_sealed(path, Card(content={"a": 1, "b": [0.1, None]}))
    values = dict(reversed(json.loads(path.read_text()).items()))
    path.write_text(json.dumps(values, indent=8))
    assert read_json(Card, path) is not None


def test_only_former_schemas_may_lack_the_digest(tmp_path: Path) -> None:
    path = tmp_path / "card.json"
    path.write_text('{"schema_version": 1, "content": 7}')
    assert read_json(Card, path) == Card(schema_version=1, content=7)
    path.write_text('{"schema_version": 2, "content": 7}')
    with pytest.raises(InputError, match="sha256: is missing"):
        read_json(Card, path)
