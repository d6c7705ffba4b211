"""The registry of predictors: what every one declares, what an installed package adds, and who names predictors."""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import cosim
from isac_cosim.base.errors import InputError
from isac_cosim.base.feedback import SILENT
from isac_cosim.base.settings import checked
from isac_cosim.evaluation.on_windows.evaluation import EvaluateSettings, evaluate_records
from isac_cosim.models import DEFAULT, FLOOR
from isac_cosim.models.data.fit_settings import OptimiserSettings
from isac_cosim.models.data.windows import Records, cut, draw_ends
from isac_cosim.models.predictors.protocol import Workload
from isac_cosim.models.predictors.registry import OWN, PREDICTORS, catalogue, section_name, sections
from isac_cosim.models.runs.run import load_run
from isac_cosim.models.runs.settings import TrainSettings
from isac_cosim.models.training.training import train_records
from isac_cosim.studies.cost_estimate import estimate_study
from isac_cosim.studies.study import Study
from tests.support.made_up import MADE_OF, SMALL_RUN

PACKAGE = '''
"""A package of somebody else: the nearest class mean of the last states of a window."""

from pathlib import Path

import numpy as np
from pydantic import Field

from isac_cosim.base.files import replace_file
from isac_cosim.base.settings import Settings
from isac_cosim.models.predictors.protocol import Outputs, Predictor, among_known


class NearestSettings(Settings):
    """Settings of the nearest mean."""

    ends_per_record: int = Field(2, ge=1, description="training windows per record")


class NearestPredictor(Predictor):
    """The nearest class mean."""

    display_name = "nearest mean"
    summary = "nearest class mean of the last states"
    settings_class = NearestSettings
    optimiser_defaults = {"epochs": 7}

    def __init__(self, means, classes):
        self.means, self.classes = means, classes

    @classmethod
    def fit(cls, task, feedback):
        ends, label = task.training_ends(task.settings.of(NearestSettings).ends_per_record)
        features = np.concatenate([states(windows) for windows in task.batches(ends)])
        classes = np.unique(label)
        return cls(np.stack([features[label == k].mean(axis=0) for k in classes]), classes)

    def save(self, folder):
        replace_file(folder / "nearest.npz", lambda path: np.savez(path, means=self.means, classes=self.classes))

    @classmethod
    def load(cls, folder, settings, shape):
        with np.load(folder / "nearest.npz", allow_pickle=False) as stored:
            return cls(stored["means"], stored["classes"])

    def __call__(self, windows):
        features = states(windows)
        distance = ((features[:, None] - self.means) ** 2).sum(axis=2)
        return Outputs(among_known(-distance, self.classes), features)


def states(windows):
    return windows.tv[:, 2:, -1].astype(float)
'''
ENTRY_POINTS = (
    "[isac_cosim.predictors]\nnearest-mean = nearest_package:NearestPredictor\nbroken = no_such_module:nothing\n"
    "loss = nearest_package:NearestPredictor\n"
)


@pytest.fixture
def installed(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """A package that offers a predictor, importable and with metadata, for the time of a test."""
    folder = tmp_path_factory.mktemp("site")
    (folder / "nearest_package.py").write_text(PACKAGE)
    metadata = folder / "nearest_package-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: nearest-package\nVersion: 1.0\n")
    (metadata / "entry_points.txt").write_text(ENTRY_POINTS)
    monkeypatch.syspath_prepend(folder)
    monkeypatch.setattr(PREDICTORS, "_items", dict(OWN))
    vars(PREDICTORS).pop("_offered", None)
    yield
    vars(PREDICTORS).pop("_offered", None)
    sys.modules.pop("nearest_package", None)


@pytest.mark.parametrize("name", OWN)
def test_every_predictor_declares_what_the_rest_relies_on(name: str) -> None:
    kind = OWN[name]
    assert kind.display_name
    assert f"{name} " in catalogue()
    assert kind.summary in catalogue()
    settings = TrainSettings(model=name)
    if kind.settings_class is not None:
        assert settings.of(kind.settings_class) == kind.settings_class()
    OptimiserSettings.model_validate(kind.optimiser_defaults)
    small, large = (kind.cost_s(Workload(n, n, n, 1.0), settings) for n in (100, 1000))
    assert 0 < small < large


def test_display_names_are_unique() -> None:
    assert len({kind.display_name for kind in OWN.values()}) == len(OWN)


def test_variants_share_the_section_of_the_first_one() -> None:
    assert {"asi_bip", "aligned", "castformer", "trees"} <= sections().keys() <= {section_name(name) for name in OWN}
    assert not {"tv_alone", "uv_alone", "ensemble", "embedding_trees"} & sections().keys()
    assert sections("tv-alone") == sections("ensemble") == sections("embedding-trees") == sections()


@pytest.mark.usefixtures("installed")
def test_a_predictor_of_an_installed_package_is_trained_loaded_and_evaluated(records: Records, tmp_path: Path) -> None:
    content = {**SMALL_RUN.model_dump(exclude={"optimiser"}), "model": "nearest-mean"}
    settings = TrainSettings.model_validate({**content, "nearest_mean": {"ends_per_record": 3}})
    assert settings.optimiser.epochs == 7
    run = train_records(records, MADE_OF, tmp_path / "run", settings, SILENT)
    assert {path.name for path in run.path.iterdir()} == {
        "run.json", "nearest.npz", "reference.npz", "pre_onset.skops",
    }  # fmt: skip
    loaded = load_run(run.path)
    assert loaded.card.settings.model_dump()["nearest_mean"] == {"ends_per_record": 3}
    windows = cut(records, draw_ends(records, settings.windows, "test")[:9], settings.windows)
    np.testing.assert_array_equal(loaded.predictor(windows).logits, run.predictor(windows).logits)
    result = evaluate_records(loaded, records, MADE_OF, tmp_path / "report", EvaluateSettings()).result
    assert (result.name, result.model) == ("nearest mean", "nearest-mean")
    assert result.macro_f1 is not None
    assert result.macro_f1 > 0.3
    again = train_records(records, MADE_OF, tmp_path / "run", settings, SILENT)
    assert again.card == run.card


@pytest.mark.usefixtures("installed")
def test_studies_and_sweeps_take_it_by_name() -> None:
    content = {"training": {"nearest_mean": {"ends_per_record": 4}}, "sweep": {"models": ["nearest-mean", "asi-bip"]}}
    study = checked(Study, content, "study.toml")
    assert [cell.model for cell in study.cells] == [FLOOR, "nearest-mean", DEFAULT]
    assert estimate_study(study).training_s > 0
    assert study.training_of("nearest-mean", 3).model_dump()["nearest_mean"] == {"ends_per_record": 4}
    assert "nearest_mean" not in study.floor.model_dump()
    with pytest.raises(InputError, match=r"study\.toml: training\.nearest_mean\.ends_per_record: .* not 0$"):
        checked(Study, {"training": {"nearest_mean": {"ends_per_record": 0}}}, "study.toml")


@pytest.mark.usefixtures("installed")
def test_a_package_that_cannot_be_used_is_reported_only_where_it_is_named() -> None:
    assert TrainSettings().model == DEFAULT
    with pytest.raises(InputError, match=r"predictor broken: package nearest-package cannot be imported"):
        TrainSettings(model="broken")
    with pytest.raises(InputError, match=r"predictor loss: its section loss is a key of \[training\]"):
        TrainSettings(model="loss")


def test_a_section_of_a_package_that_is_not_installed_is_refused() -> None:
    with pytest.raises(InputError, match=r"training\.nearest_mean: unknown key"):
        checked(Study, {"training": {"nearest_mean": {"ends_per_record": 4}}}, "study.toml")


ROOT = Path(cosim.__file__).parent
WITHOUT_NAMES = [
    ROOT / "cosim.py",
    *(ROOT / "models").glob("*.py"),
    *(ROOT / "models" / "training").glob("*.py"),
    *(ROOT / "models" / "scores").glob("*.py"),
    *(ROOT / "models" / "runs").glob("*.py"),
    # The cross-validation on clips is of one predictor alone.
    *(path for path in (ROOT / "studies").glob("*.py") if path.name != "clip_validation.py"),
]


@pytest.mark.parametrize("path", WITHOUT_NAMES, ids=lambda path: str(path.relative_to(ROOT)))
def test_no_predictor_is_named_outside_its_file_and_the_registry(path: Path) -> None:
    """The default one and the floor have a name in `models.predictors` alone."""
    names = {*OWN, *map(section_name, OWN)}
    classes = {name for kind in OWN.values() for name in (kind.__name__, getattr(kind.settings_class, "__name__", ""))}
    modules = {kind.__module__ for kind in OWN.values()}
    used = []
    for node in ast.walk(ast.parse(path.read_text())):
        match node:
            case ast.Constant(value=str(text)) if text in names:
                used.append(text)
            case ast.Attribute(attr=text) if text in names:
                used.append(text)
            case ast.Name(id=text) if text in classes:
                used.append(text)
            case ast.ImportFrom(module=str(text)) if text in modules:
                used.append(text)
    assert used == ([DEFAULT, FLOOR] if path == ROOT / "models" / "__init__.py" else [])
