"""`cosim replay`: bad input is one line and leaves nothing, and the page of a dataset is one file."""

import json
from pathlib import Path

import pytest

import cosim
from tests.support.made_up_dataset import write_dataset
from tests.support.refusals import refusal


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("replay")
    write_dataset(folder / "data")
    (folder / "foreign").mkdir()
    (folder / "foreign" / "thesis.tex").write_text("years of work")
    (folder / "mine.html").write_text("<!doctype html><title>mine</title>")
    return folder


BAD = {
    "foreign --episode toy-1 -o new.html": "foreign: is neither a run (no run.json) nor a dataset (no dataset.json)",
    "nowhere --episode toy-1 -o new.html": "nowhere: is neither a run",
    "data --episode toy-11 -o new.html": "did you mean toy-1? it has toy-0, toy-1, toy-2, toy-3",
    "data --episode toy-1 -o mine.html": "mine.html: exists and is no page of this tool",
    "data --episode toy-1 -o data": "data: is not the name of a page; let it end in .html",
    "data --episode toy-1 -o none/new.html": "there is no folder none",
    "data --data data --episode toy-1 -o new.html": "--data gives the dataset of a run",
    "data -o new.html": "Missing option '--episode'",
    "data --episode toy-1": "Missing option '-o'",
}


@pytest.mark.parametrize("line", BAD)
def test_bad_input_is_one_line_and_writes_nothing(
    line: str, folder: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(folder)
    assert BAD[line] in refusal(["replay", *line.split()], folder, capfd)


def test_the_page_of_a_dataset_without_its_scenario_is_made_and_says_so(
    folder: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    page = tmp_path / "toy.html"
    for _ in range(2):  # A page of ours is replaced.
        assert cosim.main(["replay", str(folder / "data"), "--episode", "toy-1", "-o", str(page), "--json"]) == 0
    printed = capfd.readouterr()
    result = json.loads(printed.out.splitlines()[-1])
    assert result == {"page": str(page), "records": 14, "wrong": [], "others": False}
    assert "TV and UV only: " in printed.err
    assert '<canvas id="replay"' in page.read_text()
    assert sorted(tmp_path.iterdir()) == [page]
