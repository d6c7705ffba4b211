"""What pages are made of: templates that escape, JSON that cannot end its element, scripts that parse."""

import importlib.resources
import json
import shutil
import subprocess

import pytest
from hypothesis import given
from hypothesis import strategies as st

from isac_cosim.evaluation.report.html import templates

FILES = importlib.resources.files(templates.HERE)
SCRIPTS = sorted(path.name for path in FILES.iterdir() if path.name.endswith(".js"))


@given(st.recursive(st.text() | st.integers() | st.none(), lambda inner: st.dictionaries(st.text(), inner)))
def test_embedded_json_reads_back_and_ends_no_element(content: object) -> None:
    text = templates.embedded_json({"content": content, "end": "</script><!--"})
    assert json.loads(text) == {"content": content, "end": "</script><!--"}
    assert not set("<>&\u2028\u2029") & set(text)


def test_texts_are_escaped() -> None:
    texts = {"mark": "m", "title": "<script>", "body": "<b>", "origin": "</pre><script>", "links": [], "library": None}
    page = templates.render("page.html.j2", **texts)
    assert "<title>&lt;script&gt;</title>" in page
    assert "&lt;/pre&gt;&lt;script&gt;" in page


@pytest.mark.parametrize("name", SCRIPTS)
def test_scripts_parse(name: str) -> None:
    node = shutil.which("node")
    if node is None:
        pytest.skip("node is not installed: scripts are not parsed")
    checked = subprocess.run([node, "--check", "-"], input=templates.file_text(name), capture_output=True, text=True)
    assert checked.returncode == 0, checked.stderr


@pytest.mark.parametrize("name", [path.name for path in FILES.iterdir() if not path.name.endswith((".py", "__"))])
def test_no_file_of_a_page_reaches_for_the_network(name: str) -> None:
    text = templates.file_text(name)
    for reach in (
        "http://",
        "https://",
        "@import",
        "url(",
        "fetch(",
        "XMLHttpRequest",
        "import(",
        "innerHTML",
        "eval(",
    ):
        assert reach not in text


def test_scripts_cannot_end_their_element() -> None:
    for name in SCRIPTS:
        assert "</script" not in templates.file_text(name).lower()
