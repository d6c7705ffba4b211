"""Changed and forged runs: refused in one line that names the file and what is wrong in it."""

from __future__ import annotations

import json
import shutil
import warnings
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

import cosim
from isac_cosim.base.errors import InputError
from isac_cosim.evaluation.on_windows.evaluation import evaluate_records
from isac_cosim.evaluation.on_windows.settings import EvaluateSettings
from isac_cosim.labeling.intentions import KNOWN
from isac_cosim.models.data.windows import Records, cut, draw_ends
from isac_cosim.models.runs.run import Run, load_run
from isac_cosim.models.trees.stored_trees import read_trees, write_trees
from tests.support.forged import as_former_run, forge_run, reseal
from tests.support.made_up import MADE_OF, SMALL_RUN
from tests.support.made_up_dataset import write_dataset


@pytest.fixture
def network(network_run: Run, tmp_path: Path) -> Path:
    shutil.copytree(network_run.path, tmp_path / "network")
    return tmp_path / "network"


@pytest.fixture
def trees(trees_run: Run, tmp_path: Path) -> Path:
    shutil.copytree(trees_run.path, tmp_path / "trees")
    return tmp_path / "trees"


def test_the_card_has_the_digests_of_the_files(network_run: Run) -> None:
    card = json.loads((network_run.path / "run.json").read_text())
    assert set(card["files"]) == {"weights.pt", "reference.npz", "pre_onset.skops", "history.csv"}
    assert card["schema_version"] == 2
    assert card["sha256"] == network_run.card.sha256


@pytest.mark.parametrize("file", ["weights.pt", "reference.npz", "pre_onset.skops", "history.csv"])
def test_a_flipped_bit_is_noticed(network: Path, file: str) -> None:
    content = bytearray((network / file).read_bytes())
    content[len(content) // 2] ^= 1
    (network / file).write_bytes(content)
    with pytest.raises(InputError, match=rf"{file}: its bytes differ from the digest in run\.json"):
        load_run(network)


def test_a_missing_file_is_named(network: Path) -> None:
    (network / "reference.npz").unlink()
    with pytest.raises(InputError, match=r"reference\.npz"):
        load_run(network)


@pytest.mark.parametrize(("key", "value"), [("unknown_threshold", 0.5), ("temperature", 1.25), ("best_epoch", 0)])
def test_a_changed_card_is_noticed(network: Path, key: str, value: object) -> None:
    """Values that could as well be right."""
    content = json.loads((network / "run.json").read_text())
    assert content[key] != value
    (network / "run.json").write_text(json.dumps(content | {key: value}))
    with pytest.raises(InputError, match=r"run\.json: sha256: differs from the content"):
        load_run(network)


CARDS: dict[str, tuple[dict[str, Any], str]] = {
    "no temperature": ({"temperature": 0.0}, "temperature: must be at least"),
    "an unknown score": ({"unknown_score": "magic"}, "unknown_score: unknown value 'magic'"),
    "rates of 1e9": ({"tv_rate_hz": 1e9}, "tv_rate_hz: must be at most"),
    "rates that do not fit": ({"tv_rate_hz": 200.0}, "tv_length: is not what"),
    "negative counts": ({"counts": {"overtake": -1}}, "counts.overtake: must be at least 0"),
    "classes in another order": ({"classes": [i.text for i in reversed(KNOWN)]}, "classes: are not"),
    "an unknown side": ({"split": {"exam": ["toy-1"]}}, "split: exam is not one of"),
    "a side without seeds": ({"split": {"validation": ["toy-1"], "test": ["toy-2"]}}, "split: train is missing"),
    "a data set without a digest": ({"dataset": {}}, "dataset: has no digest"),
    "files that lie elsewhere": ({"files": {"../weights.pt": "0" * 64}}, "files"),
    "no files": ({"files": {}}, "files: is empty"),
}


@pytest.mark.parametrize("change", CARDS)
def test_a_forged_card_is_refused(network: Path, change: str) -> None:
    update, fault = CARDS[change]
    path = network / "run.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | update))
    reseal(path)
    with pytest.raises(InputError, match=rf"run\.json: .*{fault}"):
        load_run(network)


def test_a_network_of_terabytes_is_refused_without_taking_memory(network: Path) -> None:
    path = network / "run.json"
    content = json.loads(path.read_text())
    content["settings"]["asi_bip"] |= {"width": 2**16, "hidden": 2**16}
    path.write_text(json.dumps(content))
    reseal(path)
    with pytest.raises(InputError, match=r"weights\.pt: .*is float32"):
        load_run(network)


def state_changed(change: Callable[[dict[str, torch.Tensor]], None]) -> Callable[[Path], None]:
    def write(folder: Path) -> None:
        state = torch.load(folder / "weights.pt", weights_only=True)
        change(state)
        torch.save(state, folder / "weights.pt")

    return write


def set_to(name: str, value: float) -> Callable[[Path], None]:
    return state_changed(lambda state: state.update({name: torch.full_like(state[name], value)}))


def array_changed(**arrays: Any) -> Callable[[Path], None]:
    def write(folder: Path) -> None:
        with np.load(folder / "reference.npz") as stored:
            content = dict(stored)
        for name, change in arrays.items():
            content[name] = change(content[name])
        np.savez(folder / "reference.npz", **content)

    return write


FORGED: dict[str, tuple[Callable[[Path], None], str]] = {
    "NaN": (set_to("head.1.weight", np.nan), r"weights\.pt: head\.1\.weight: holds numbers that are not finite"),
    "zeros": (set_to("head.1.weight", 0.0), r"weights\.pt: head\.1\.weight: is zero throughout"),
    "a scale of 0": (set_to("tv_sd", 0.0), r"weights\.pt: tv_sd: is a scale that is not positive"),
    "another shape": (
        state_changed(lambda state: state.update({"norm.weight": torch.ones(3)})),
        r"weights\.pt: norm\.weight: is float32 \(3,\), not float32 \(16,\)",
    ),
    "a tensor of claimed terabytes": (
        state_changed(lambda state: state.update({"norm.weight": torch.ones(1).expand(2**40)})),
        r"weights\.pt: norm\.weight: is float32",
    ),
    "another type": (
        state_changed(lambda state: state.update({"norm.weight": torch.ones(16, dtype=torch.int64)})),
        r"weights\.pt: norm\.weight: is int64",
    ),
    "a missing tensor": (state_changed(lambda state: state.__delitem__("norm.weight")), r".*norm\.weight: is missing"),
    "a tensor too many": (state_changed(lambda state: state.update({"x": torch.ones(1)})), r".*x: belongs to another"),
    "no tensors": (lambda folder: torch.save([1, 2], folder / "weights.pt"), r"weights\.pt: holds no values by name"),
    "a reference that is NaN": (
        array_changed(features=lambda x: x * np.nan),
        r"reference\.npz: features: holds numbers",
    ),
    "a reference without windows": (
        array_changed(features=lambda x: x[:0], label=lambda x: x[:0]),
        r"reference\.npz: features: are none",
    ),
    "labels of 99": (array_changed(label=lambda x: x + 99), r"reference\.npz: label: is not a known intention"),
    "fewer labels": (array_changed(label=lambda x: x[:-1]), r"reference\.npz: features: has the shape"),
    "a reference of another width": (array_changed(features=lambda x: x[:, :5]), r"pre_onset\.skops: n_features_in_"),
}


@pytest.mark.parametrize("former", [False, True], ids=["forged", "former"])
@pytest.mark.parametrize("change", FORGED)
def test_a_forged_file_is_refused_by_its_content(network: Path, change: str, former: bool) -> None:
    """Its digest is right, or the run is of a version that stored none."""
    write, fault = FORGED[change]
    write(network)
    (as_former_run if former else forge_run)(network)
    with pytest.raises(InputError, match=rf"network: the run is damaged \({fault}"):
        load_run(network)


def test_the_score_needs_its_trees(network: Path) -> None:
    path = network / "run.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {"unknown_score": "pre_onset"}))
    (network / "pre_onset.skops").unlink()
    content = json.loads(path.read_text())
    del content["files"]["pre_onset.skops"]
    path.write_text(json.dumps(content))
    reseal(path)
    with pytest.raises(InputError, match=r"pre_onset\.skops: is missing, on which unknown_score rests"):
        load_run(network)


NODES: dict[str, tuple[Callable[[Any], None], str]] = {
    "a cycle": (lambda nodes: nodes["left"].__setitem__(0, 0), r"tree 0: the left child of node 0 is node 0"),
    "a child that is not there": (lambda nodes: nodes["right"].__setitem__(0, 10**9), "tree 0: the right child"),
    "a feature that is not there": (lambda nodes: nodes["feature_idx"].__setitem__(0, 10**12), "tree 0: node 0 asks"),
    "a negative feature": (lambda nodes: nodes["feature_idx"].__setitem__(0, -(10**12)), "tree 0: node 0 asks"),
    "a category": (lambda nodes: nodes["is_categorical"].__setitem__(0, 1), "tree 0: a node asks for a category"),
    "a threshold that is NaN": (lambda nodes: nodes["num_threshold"].__setitem__(0, np.nan), "tree 0: a threshold"),
    "a value that is infinite": (
        lambda nodes: nodes["value"].__setitem__(-1, np.inf),
        "tree 0: a threshold or a value",
    ),
}


@pytest.mark.parametrize("change", NODES)
def test_trees_that_do_not_end_or_look_outside_are_refused(trees: Path, change: str) -> None:
    """scikit-learn's compiled loops would run for ever, or read memory that is not theirs."""
    forest = read_trees(trees / "trees.skops", None, KNOWN)
    NODES[change][0](forest._predictors[0][0].nodes)
    write_trees(trees / "trees.skops", forest)
    forge_run(trees)
    with pytest.raises(InputError, match=rf"trees\.skops: {NODES[change][1]}"):
        load_run(trees)


ATTRIBUTES: dict[str, tuple[str, Any, str]] = {
    "no nodes": ("_predictors", [[]], "_predictors"),
    "other classes": ("classes_", np.array([0, 1, 2, 3, 4, 99]), "classes_"),
    "classes twice": ("classes_", np.array([0, 1, 1, 3, 4, 5]), "classes_"),
    "more features": ("n_features_in_", 999, "n_features_in_"),
    "a baseline that is NaN": ("_baseline_prediction", np.full((1, 6), np.nan), "_baseline_prediction"),
    "a baseline of another shape": ("_baseline_prediction", np.zeros((1, 9)), "_baseline_prediction"),
    "a method that is a number": ("decision_function", 1, "an attribute hides"),
    "a preprocessor": ("_preprocessor", [1], "_preprocessor"),
}


@pytest.mark.parametrize("change", ATTRIBUTES)
def test_trees_of_another_kind_are_refused(trees: Path, change: str) -> None:
    name, value, fault = ATTRIBUTES[change]
    forest = read_trees(trees / "trees.skops", None, KNOWN)
    setattr(forest, name, value)
    write_trees(trees / "trees.skops", forest)
    forge_run(trees)
    with pytest.raises(InputError, match=rf"trees\.skops: {fault}"):
        load_run(trees)


def test_only_the_types_of_trees_are_read(trees: Path) -> None:
    """skops by itself trusts every estimator of scikit-learn."""
    import skops.io
    from sklearn.linear_model import LogisticRegression

    skops.io.dump([LogisticRegression()], trees / "trees.skops")
    forge_run(trees)
    with pytest.raises(InputError, match=r"trees\.skops: holds an object of the type sklearn\.linear_model"):
        load_run(trees)


def test_trees_that_name_no_version_are_read_without_a_warning(trees: Path) -> None:
    with zipfile.ZipFile(trees / "trees.skops") as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    schema = members["schema.json"]
    assert b"_sklearn_version" in schema
    with zipfile.ZipFile(trees / "trees.skops", "w") as archive:
        for name, content in {**members, "schema.json": schema.replace(b"_sklearn_version", b"_version")}.items():
            archive.writestr(name, content)
    forge_run(trees)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        load_run(trees)


def test_another_runs_files_are_refused(trees: Path, network: Path) -> None:
    shutil.copy(network / "reference.npz", trees / "reference.npz")
    with pytest.raises(InputError, match=r"reference\.npz: its bytes differ"):
        load_run(trees)
    (trees / "pre_onset.skops").unlink()
    content = json.loads((trees / "run.json").read_text())
    (trees / "run.json").write_text(json.dumps(content | {"unknown_score": "msp"}))
    as_former_run(trees)
    run = load_run(trees)
    windows = cut(*few_windows())
    with pytest.raises(InputError, match="features are of 140 numbers a window, not 16; its files belong to different"):
        run.answer(windows)


def few_windows() -> tuple[Any, Any, Any]:
    from tests.support.made_up import make_records

    records = make_records(1, 1)
    return records, draw_ends(records, SMALL_RUN.windows, "test")[:4], SMALL_RUN.windows


def test_answers_that_are_not_finite_are_refused(network: Path) -> None:
    """Every number in the file is finite, but not what becomes of them."""
    set_to("head.1.weight", 3e38)(network)
    forge_run(network)
    with pytest.raises(InputError, match="logits are not finite, or beyond 1e"):
        load_run(network).answer(cut(*few_windows()))


def test_runs_of_former_versions_open_and_answer_as_before(network: Path, trees: Path, records: Records) -> None:
    windows = cut(records, draw_ends(records, SMALL_RUN.windows, "test")[:9], SMALL_RUN.windows)
    for folder in (network, trees):
        before = load_run(folder).answer(windows)
        as_former_run(folder)
        run = load_run(folder)
        assert (run.card.files, run.card.sha256) == ({}, None)
        np.testing.assert_array_equal(run.answer(windows).logits, before.logits)


def test_an_evaluation_names_what_it_read(network_run: Run, records: Records, tmp_path: Path) -> None:
    result = evaluate_records(network_run, records, MADE_OF, tmp_path / "out", EvaluateSettings()).result
    stored = json.loads((tmp_path / "out/metrics.json").read_text())["made_by"]
    assert stored["dataset"]["digest"] == MADE_OF["digest"]
    assert stored["runs"][0]["sha256"] == json.loads((network_run.path / "run.json").read_text())["sha256"]
    assert stored["runs"][0]["files"] == dict(result.made_by.runs[0].files)


@pytest.mark.slow
def test_the_command_line_says_once_that_a_run_has_no_digests(
    trees: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("isac_cosim.evaluation.report.report.draw_figures", lambda *_: None)
    write_dataset(tmp_path / "data", "road", seeds=3, per_class=1)
    assert cosim.main(["evaluate", "trees", "--data", "data", "-o", "before"]) == 0
    assert "no digests" not in capsys.readouterr().err
    as_former_run(trees)
    assert cosim.main(["evaluate", "trees", "--data", "data", "-o", "after"]) == 0
    assert capsys.readouterr().err.count("of a version that stored no digests") == 1
    assert (tmp_path / "before/predictions.parquet").read_bytes() == (
        tmp_path / "after/predictions.parquet"
    ).read_bytes()
