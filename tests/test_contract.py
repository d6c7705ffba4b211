"""Whatever the input, the contract of the command line holds: its exit codes, one line of what is wrong, no traceback.

What takes long (simulating, training, predicting, timing) is replaced by `Begun`: a case that gets there was taken as
right. Everything before it is real: parsing, checking, reading, claiming folders, converting maps.
"""

from __future__ import annotations

import collections
import contextlib
import io
import json
import os
import shutil
import tempfile
import warnings
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import cosim
from isac_cosim.base.errors import RunError
from isac_cosim.labeling.generation.generate import generate
from isac_cosim.models.runs.settings import TrainSettings
from isac_cosim.models.training.training import train
from isac_cosim.studies.single import claim_study
from isac_cosim.studies.study import Study, read_study
from tests.support.made_up_videos import write_event
from tests.support.mutations import ODD_NUMBERS, ODD_TEXTS, Spoilt, attribute_changed, changed, garbled, spoilt, toml
from tests.support.roads import straight_road, vehicle
from tests.support.scripted import InlineEngine, ScriptedSource, small_study

BEGUN = "the work itself begins"
MAP = (
    '<?xml version="1.0"?><osm version="0.6">'
    + "".join(f'<node id="{k}" lat="52.0" lon="{10 + 0.004 * k}" version="1"/>' for k in range(1, 7))
    + '<way id="9" version="1">'
    + "".join(f'<nd ref="{k}"/>' for k in range(1, 7))
    + '<tag k="highway" v="motorway"/><tag k="lanes" v="3"/><tag k="oneway" v="yes"/></way></osm>'
)
QUICK, SLOW = 35, 700
"""Cases of each of the three kinds; the slow run has more than two thousand."""
met: collections.Counter[str] = collections.Counter()
"""What the cases of this run met, by command and exit code."""


def begin(*_: object, **__: object) -> Any:
    raise RunError(BEGUN)


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with one right input of every kind: scenario, network, map, dataset, run and study."""
    folder = tmp_path_factory.mktemp("inputs")
    straight_road(folder / "road", vehicle("a") + vehicle("b", depart=3.0))
    for leftover in ("r.nod.xml", "r.edg.xml"):
        (folder / "road" / leftover).unlink()
    config = folder / "road/r.sumocfg"
    config.write_text(config.read_text().replace("<input>", '<time><step-length value="1"/></time><input>'))
    shutil.copy(folder / "road/r.net.xml", folder / "bare.net.xml")
    (folder / "map.osm").write_text(MAP)
    (folder / "scripted").mkdir()
    study = small_study(seeds={"first": 1, "last": 4})
    dataset = generate(study, folder / "data", InlineEngine(), source=ScriptedSource(folder / "scripted"))
    shutil.rmtree(folder / "scripted")
    few = {"trees": {"rounds": 2}, "pre_onset": {"rounds": 2}, "optimiser": {"threads": 1}}
    train(dataset, folder / "run", TrainSettings.model_validate({"model": "trees", **few}))
    (folder / "study.toml").write_text('[dataset]\nscenarios = ["road"]\nseeds = { first = 1, last = 2 }\n')
    with claim_study(folder / "results", read_study(folder / "study.toml")):
        pass
    write_event(folder / "videos", "lturn", "20141019_091035_1_26", 25, rate_hz=5)
    (folder / "empty").mkdir()
    (folder / "full").mkdir()
    (folder / "full/thesis.tex").write_text("years of work")
    (folder / "binary.toml").write_bytes(bytes(range(256)))
    (folder / "huge.toml").write_text("# " + "x" * 2_000_000)
    return folder


@pytest.fixture(autouse=True)
def work_replaced(monkeypatch: pytest.MonkeyPatch) -> None:
    for place in (
        "isac_cosim.base.workers.engine.LocalEngine.run",
        "isac_cosim.base.workers.kept_workers.KeptWorkers.run",
        "isac_cosim.models.networks.fitting.fit_network",
        "isac_cosim.models.predictors.trees.fit_trees",
        "isac_cosim.models.predictors.trees.TreesPredictor.__call__",
    ):
        monkeypatch.setattr(place, begin)
    monkeypatch.setattr("isac_cosim.base.workers.cluster.ANSWER_S", 0.05)
    monkeypatch.setattr(
        "isac_cosim.benchmarks.importlib", SimpleNamespace(import_module=lambda _: SimpleNamespace(run=begin))
    )
    with contextlib.suppress(AttributeError):
        monkeypatch.setattr("typer.rich_utils.MAX_WIDTH", 120)


@contextlib.contextmanager
def copy_of(inputs: Path) -> Iterator[Path]:
    """Every case has the inputs for itself, and is run in their folder."""
    before = Path.cwd()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "inputs"
        shutil.copytree(inputs, folder)
        os.chdir(folder)
        try:
            yield folder
        finally:
            os.chdir(before)


def files(folder: Path) -> dict[Path, bytes | None]:
    """Everything in a folder."""
    return {path: path.read_bytes() if path.is_file() and not path.is_symlink() else None for path in folder.rglob("*")}


def check(folder: Path, words: Sequence[str]) -> None:
    """Run a command and hold what it did against the contract."""
    out, err = io.StringIO(), io.StringIO()
    before = files(folder)
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err), warnings.catch_warnings():
        warnings.simplefilter("default")
        for kind in (DeprecationWarning, PendingDeprecationWarning, ResourceWarning):
            warnings.simplefilter("ignore", kind)
        warnings.showwarning = lambda message, *_, **__: print(f"Warning: {message}", file=err)
        code = cosim.main(words)
    printed = err.getvalue()
    command = " ".join(words[:2]) if words[:1] == ["network"] else "".join(words[:1])
    met[f"{command if len(command) < 20 else '(other)'} {code}"] += 1
    assert "Traceback" not in printed, printed
    assert "Warning: " not in printed, printed
    assert code in (0, 1, 2), (code, printed)
    if code == 1:
        assert printed.splitlines()[-1] == f"cosim: {BEGUN}"
    if code == 2:
        assert out.getvalue() == ""
        *said, line = printed.splitlines()
        # What a command warns of, it says as it meets it, and a training only once it works; the refusal is one line.
        assert all(warning.startswith("warning: ") for warning in said), printed
        assert words[0] != "train" or said == [], printed
        assert line.startswith("cosim: ")
        assert line.isprintable(), printed
        assert len(printed) < 2000, printed[:2000]
        assert files(folder) == before


def hold(case: st.SearchStrategy[Any], one: Callable[[Any], None], examples: int) -> None:
    """Try a number of cases; the few of the default run are the same every time."""

    @settings(
        max_examples=examples,
        deadline=None,
        derandomize=examples == QUICK,
        database=None,
        suppress_health_check=list(HealthCheck),
    )
    @given(case)
    def tried(drawn: Any) -> None:
        one(drawn)

    tried()


sizes = pytest.mark.parametrize("examples", [QUICK, pytest.param(SLOW, marks=pytest.mark.slow)])


def studies(inputs: Path) -> st.SearchStrategy[bytes]:
    """Studies as files: with a few values changed at any level, garbled, deeply nested, of noise."""
    whole = Study().model_dump(mode="json")
    whole["dataset"] |= {"scenarios": ["road"], "seeds": {"first": 1, "last": 2}}
    short = {"dataset": {"scenarios": ["road"], "seeds": {"first": 1, "last": 2}}, "training": {"model": "trees"}}
    text = toml(whole).encode()
    return st.one_of(
        changed(whole, most=2).map(lambda content: toml(content).encode(errors="surrogatepass")),
        changed(whole, most=1).map(lambda content: toml(content).encode(errors="surrogatepass")),
        changed(short).map(lambda content: toml(content).encode(errors="surrogatepass")),
        garbled(text),
        st.binary(max_size=40),
        st.text(max_size=60).map(lambda text: text.encode(errors="surrogatepass")),
        st.sampled_from([100, 1000, 50_000]).map(lambda depth: b"dataset = " + b"[" * depth + b"1" + b"]" * depth),
        st.sampled_from([100, 2000]).map(lambda depth: b"a" + b".a" * depth + b" = 1"),
        st.sampled_from([100, 20_000]).map(lambda depth: b"dataset = " + b"{a = " * depth + b"1" + b"}" * depth),
    )


@sizes
def test_studies(inputs: Path, examples: int) -> None:
    options = st.lists(
        st.sampled_from(["--dry-run", "--quiet", "--json", "--verbose", "--jobs=2", "-oout"]), unique=True, max_size=3
    )

    def one(case: tuple[bytes, list[str]]) -> None:
        content, words = case
        with copy_of(inputs) as folder:
            (folder / "case.toml").write_bytes(content)
            check(folder, ["run", "case.toml", *words])

    hold(st.tuples(studies(inputs), options), one, examples)


PATHS = (
    "road", "road/r.sumocfg", "road/r.net.xml", "bare.net.xml", "map.osm", "data", "run", "study.toml", "empty", "full",
    "binary.toml", "huge.toml", "data/dataset.json", "data/shards/road-1.parquet", "nowhere", "nowhere/deep", "new",
    "videos", "videos/road_camera/lturn/20141019_091035_1_26.avi",
)  # fmt: skip
ARGUMENTS = {
    "run": ("study.toml",), "generate": ("road",), "sense": ("data",), "inspect": ("data",), "train": ("data",),
    "evaluate": ("run", "--data", "data"), "network import": ("map.osm",), "network sites": ("bare.net.xml",),
    "bench": ("echo",), "describe": ("data",), "export": ("data", "--sample", "road-2-0", "--csv"),
    "clips": ("videos", "--driver-cut", "64x64"),
}  # fmt: skip
OPTIONS = {
    "--windows": "100", "--seeds": "1:3", "--snr": "0:10", "--jobs": "2", "--cluster": "tcp://127.0.0.1:9",
    "--sensor": "radar", "--estimator": "ml", "--fusion": "eq5", "--sites": "2", "--rain": "5", "--radar": "nlos",
    "--pattern": "random", "--records": "9", "--model": "trees", "--epochs": "2", "--seed": "3", "--data": "data",
    "--held-out": "overtake", "--against": "run", "--box": "9.9,51.9,10.1,52.1", "--spacing": "100", "--set-back": "10",
    "--height": "12", "--vehicles": "20", "--alone": "run", "--colour": "red",
    "--episode": "road-2", "--step": "0.1", "--from": "1", "--to": "2", "--log": "tensorboard",
    "--driver-cut": "32x32+1+1", "--road-weights": "run/trees.skops", "--driver-weights": "nowhere",
}  # fmt: skip
FLAGS = (
    "--complete-only",
    "--fcd",
    "--mcap",
    "--dry-run",
    "--json",
    "--quiet",
    "--verbose",
    "--verify",
    "--no-blockage",
    "--truth",
    "--help",
    "--",
    "-x",
)
odd_words = st.one_of(
    st.sampled_from(PATHS),
    st.sampled_from(ODD_TEXTS).filter(lambda text: "\x00" not in text),
    st.sampled_from(ODD_NUMBERS).map(str),
    # What a shell can hand over: no zero byte; what is no UTF-8 comes as surrogates.
    st.binary(max_size=6).filter(lambda raw: 0 not in raw and not raw.startswith(b"/")).map(os.fsdecode),
    st.tuples(st.integers(), st.sampled_from(":,"), st.floats()).map(lambda parts: "".join(map(str, parts))),
)


@st.composite
def command_lines(draw: st.DrawFn) -> list[str]:
    """A right command line with up to three of its words replaced, left out, doubled, or joined by others."""
    command = draw(st.sampled_from([*list(ARGUMENTS) * 5, "network", "fly"]))
    words = [
        *command.split(),
        *ARGUMENTS.get(command, ()),
        *draw(st.sampled_from([["-o", "new"], ["-o", "new"], ["-o", "new"], []])),
    ]
    for name in draw(st.lists(st.sampled_from(list(OPTIONS)), unique=True, max_size=3)):
        words += [name, draw(st.one_of(st.just(OPTIONS[name]), odd_words))]
    words += draw(st.lists(st.sampled_from(FLAGS), unique=True, max_size=2))
    for _ in range(draw(st.sampled_from([0, 0, 1, 1, 2, 3]))):
        at = draw(st.sampled_from([*range(min(1, len(words)), len(words) + 1), 0]))
        words[at : at + draw(st.integers(0, 1))] = draw(st.lists(odd_words, max_size=1))
    return words


@sizes
def test_command_lines(inputs: Path, examples: int) -> None:
    def one(words: list[str]) -> None:
        with copy_of(inputs) as folder:
            check(folder, words)

    hold(command_lines(), one, examples)


READERS = {
    "road/r.net.xml": ("generate road -o new", "network sites road/r.net.xml -o new"),
    "road/r.sumocfg": ("generate road -o new", "network sites road -o new"),
    "road/r.rou.xml": ("generate road -o new",),
    "road/sites.add.xml": ("generate road -o new", "network sites road -o new"),
    "bare.net.xml": ("network sites bare.net.xml -o new",),
    "map.osm": ("network import map.osm -o new",),
    "data/dataset.json": (
        "inspect data", "inspect data --verify --json", "train data -o new", "sense data -o new",
        "evaluate run --data data", "generate road -o data",
    ),
    "data/shards.parquet": (
        "inspect data", "inspect data --verify --json", "train data -o new", "sense data -o new",
        "evaluate run --data data", "generate road -o data",
    ),
    "data/shards/road-2.parquet": (
        "inspect data", "inspect data --verify", "train data -o new", "evaluate run --data data",
        "export data --sample road-2-0 --csv -o new",
    ),
    "data/roads/road.parquet": ("sense data -o new --sensor truth", "evaluate run --data data"),
    "results/study.json": ("run study.toml -o results",),
    "run/run.json": ("evaluate run --data data", "train data -o run --model trees"),
    "run/trees.skops": ("evaluate run --data data",),
    "run/reference.npz": ("evaluate run --data data",),
}  # fmt: skip


def changes_of(file: str, content: bytes) -> st.SearchStrategy[bytes]:
    """Changes that leave the file what it is by its form."""
    if file.endswith(".json"):
        return changed(json.loads(content)).map(lambda value: json.dumps(value).encode())
    return garbled(content) if file.endswith((".parquet", ".skops", ".npz")) else attribute_changed(content)


@sizes
def test_files(inputs: Path, examples: int) -> None:
    @st.composite
    def cases(draw: st.DrawFn) -> tuple[Spoilt, list[str]]:
        file = draw(st.sampled_from(list(READERS)))
        content = (inputs / file).read_bytes()
        return draw(spoilt(file, content, changes_of(file, content))), draw(st.sampled_from(READERS[file])).split()

    def one(case: tuple[Spoilt, list[str]]) -> None:
        with copy_of(inputs) as folder:
            case[0].apply(folder)
            check(folder, case[1])

    hold(cases(), one, examples)


@pytest.fixture(scope="module", autouse=True)
def told() -> Iterator[None]:
    """Tells, with `pytest -s`, what the cases met."""
    yield
    print(dict(sorted(met.items())))
