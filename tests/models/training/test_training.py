"""Training: a run's folder, resuming, what it refuses, and that its files execute nothing."""

import json
import pickle
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import skops.io
import torch
from pydantic import ValidationError

from isac_cosim.base.errors import InputError, RunError
from isac_cosim.evaluation.on_windows.evaluation import evaluate_records
from isac_cosim.evaluation.on_windows.prediction_table import PREDICTIONS_FILE
from isac_cosim.evaluation.on_windows.settings import EvaluateSettings
from isac_cosim.evaluation.report.figures import read_history
from isac_cosim.labeling.intentions import Intention
from isac_cosim.models.data.windows import Records, Windows, cut, draw_ends
from isac_cosim.models.networks import fitting
from isac_cosim.models.networks.lightning_module import Share
from isac_cosim.models.predictors.asi_bip import AsiBipSettings
from isac_cosim.models.predictors.protocol import Outputs
from isac_cosim.models.predictors.registry import PREDICTORS
from isac_cosim.models.predictors.trees import TreesPredictor
from isac_cosim.models.runs.run import Run, load_run
from isac_cosim.models.runs.settings import TrainSettings
from isac_cosim.models.training import training
from isac_cosim.models.training.training import train_records
from tests.support.forged import forge_run
from tests.support.made_up import MADE_OF, SMALL_RUN, on_disk


def windows_of(records: Records, run: Run):  # type: ignore[no-untyped-def]
    ends = draw_ends(records, run.card.settings.windows, "test")[:16]
    return cut(records, ends, run.card.settings.windows)


@pytest.mark.parametrize("kind", ["network_run", "trees_run"])
def test_a_loaded_run_answers_like_the_trained_one(kind: str, records: Records, request: pytest.FixtureRequest) -> None:
    run: Run = request.getfixturevalue(kind)
    windows = windows_of(records, run)
    out = load_run(run.path).predictor(windows)
    np.testing.assert_array_equal(out.logits, run.predictor(windows).logits)
    assert out.logits.shape == (16, 6)
    np.testing.assert_allclose(out.probabilities.sum(axis=1), 1)


def test_the_network_learns(network_run: Run) -> None:
    history = pd.read_csv(network_run.path / "history.csv")
    assert list(history["epoch"]) == [0, 1, 2]
    assert history["train_loss"].iloc[-1] < 0.8 * history["train_loss"].iloc[0]
    best = int(history["validation_macro_f1"].to_numpy().argmax())
    assert network_run.card.best_epoch == best
    assert network_run.card.validation_macro_f1 == pytest.approx(history["validation_macro_f1"][best], abs=1e-6)


def test_the_card_says_what_made_it(network_run: Run, records: Records) -> None:
    card = json.loads((network_run.path / "run.json").read_text())
    assert card["complete"] is True
    assert card["dataset"] == MADE_OF
    assert set(card["classes"]) == set(card["counts"])
    assert "following" not in card["classes"]
    assert sum(card["counts"].values()) == ((records.label < 6) & np.isin(records.groups, card["split"]["train"])).sum()


class Stop(fitting.History):
    """Stands for a kill in the second epoch."""

    def on_train_batch_start(self, trainer, *_):  # type: ignore[no-untyped-def]
        if trainer.current_epoch == 1:
            raise KeyboardInterrupt


def test_a_killed_training_goes_on_to_the_run_that_would_have_been(
    records: Records, network_run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With states on disk, while those of the undisturbed training were in memory."""
    with monkeypatch.context() as patched:
        patched.setattr(fitting, "History", Stop)
        with pytest.raises(KeyboardInterrupt):
            train_records(on_disk(records), MADE_OF, tmp_path / "run", SMALL_RUN)
    with pytest.raises(InputError, match="not finished"):
        load_run(tmp_path / "run")
    resumed = train_records(on_disk(records), MADE_OF, tmp_path / "run", SMALL_RUN)
    for name in ("history.csv", "run.json"):
        assert (resumed.path / name).read_bytes() == (network_run.path / name).read_bytes()
    first, second = (torch.load(run.path / "weights.pt", weights_only=True) for run in (network_run, resumed))
    assert all(torch.equal(first[name], second[name]) for name in first)


def test_all_of_a_training_keeps_to_its_threads(
    records: Records, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    threads = []

    def spied(*arguments: object) -> dict[str, object]:
        threads.append(torch.get_num_threads())
        return choose(*arguments)  # type: ignore[arg-type]

    choose = training._choose_on_validation
    monkeypatch.setattr(training, "_choose_on_validation", spied)
    one = SMALL_RUN.optimiser.model_copy(update={"epochs": 1, "threads": 1})
    before = torch.get_num_threads()
    torch.set_num_threads(3)
    try:
        settings = SMALL_RUN.model_copy(update={"model": "ensemble", "optimiser": one})
        train_records(records, MADE_OF, tmp_path / "run", settings)
        assert (threads, torch.get_num_threads()) == ([1], 3)
    finally:
        torch.set_num_threads(before)


def test_a_finished_training_is_not_repeated(
    records: Records, network_run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(training, "_fill", None)
    again = train_records(records, MADE_OF, network_run.path, SMALL_RUN)
    assert again.card == network_run.card


def test_foreign_folders_and_other_runs_are_left_alone(records: Records, network_run: Run, tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("mine")
    with pytest.raises(InputError, match="no run"):
        train_records(records, MADE_OF, tmp_path, SMALL_RUN)
    with pytest.raises(InputError, match="other settings"):
        train_records(records, MADE_OF, network_run.path, SMALL_RUN.model_copy(update={"seed": 7}))
    with pytest.raises(InputError, match="another dataset"):
        train_records(records, {**MADE_OF, "digest": "other"}, network_run.path, SMALL_RUN)


def test_two_trainings_in_one_folder_do_not_meet(
    records: Records, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = tmp_path / "run"
    settings = SMALL_RUN.model_copy(update={"model": "trees"})

    def second(*_: object) -> None:
        with pytest.raises(InputError, match="run: another command is writing it"):
            train_records(records, MADE_OF, run, settings)
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(TreesPredictor, "fit", second)
        with pytest.raises(KeyboardInterrupt):
            train_records(records, MADE_OF, run, settings)
    assert train_records(records, MADE_OF, run, settings).card.complete


def test_a_folder_that_is_not_a_run_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="not a run"):
        load_run(tmp_path / "nothing")
    (tmp_path / "run.json").write_text('{"schema_version": 1}')
    with pytest.raises(InputError, match=r"run\.json"):
        load_run(tmp_path)


class Evil:
    """A pickle that would leave a file behind."""

    def __init__(self, mark: Path) -> None:
        self.mark = mark

    def __reduce__(self):  # type: ignore[no-untyped-def]
        return Path.touch, (self.mark,)


@pytest.mark.parametrize(
    ("kind", "file"),
    [
        ("network_run", "weights.pt"),
        ("trees_run", "trees.skops"),
        ("network_run", "reference.npz"),
        ("network_run", "pre_onset.skops"),
    ],
)
def test_loading_executes_nothing(kind: str, file: str, tmp_path: Path, request: pytest.FixtureRequest) -> None:
    run = tmp_path / "run"
    shutil.copytree(request.getfixturevalue(kind).path, run)
    evil = Evil(tmp_path / "mark")
    objects = np.array([evil], object)
    for write in (
        lambda: torch.save(evil, run / file),
        lambda: write_pickle(run / file, tmp_path),
        lambda: np.savez(run / "reference.npz", features=objects, label=objects),
    ):
        write()
        forge_run(run)
        with pytest.raises(InputError, match="damaged"):
            load_run(run)
        assert not (tmp_path / "mark").exists()


def write_pickle(path: Path, folder: Path) -> None:
    path.write_bytes(pickle.dumps(Evil(folder / "mark"), protocol=2))


def test_a_file_of_something_else_is_reported(trees_run: Run, tmp_path: Path) -> None:
    run = tmp_path / "run"
    shutil.copytree(trees_run.path, run)
    skops.io.dump([1, 2], run / "trees.skops")
    forge_run(run)
    with pytest.raises(InputError, match=r"damaged \(trees\.skops: holds no trees\)"):
        load_run(run)


def test_damaged_weights_are_reported(network_run: Run, tmp_path: Path) -> None:
    run = tmp_path / "run"
    shutil.copytree(network_run.path, run)
    (run / "weights.pt").write_bytes((run / "weights.pt").read_bytes()[:500])
    forge_run(run)
    with pytest.raises(InputError, match="damaged"):
        load_run(run)


@pytest.mark.parametrize("content", ["", "epoch\n1\n", "epoch,train_loss\na,b\n", "\x00"])
def test_a_damaged_history_is_reported(content: str, tmp_path: Path) -> None:
    (tmp_path / "history.csv").write_text(content)
    with pytest.raises(InputError, match=r"history\.csv: is damaged"):
        read_history(tmp_path / "history.csv")


def test_a_dataset_without_known_intentions_is_refused(records: Records, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="known intentions"):
        train_records(records.take(records.label == 6), MADE_OF, tmp_path / "run", TrainSettings())


def test_a_held_out_intention_is_not_trained_and_not_chosen_on(records: Records, tmp_path: Path) -> None:
    settings = SMALL_RUN.model_copy(update={"model": "trees", "held_out": "overtake"})
    run = train_records(records, MADE_OF, tmp_path / "run", settings)
    assert run.card.counts["overtake"] == 0
    assert Intention.OVERTAKE not in run.reference[1]
    garbled = records.tv.copy()
    garbled[records.label == Intention.OVERTAKE] = 0
    other = Records(garbled, records.uv, records.tv_rate_hz, records.uv_rate_hz, records.table)
    again = train_records(other, MADE_OF, tmp_path / "again", settings)
    assert again.card == run.card
    windows = windows_of(records, run)
    np.testing.assert_array_equal(again.predictor(windows).logits, run.predictor(windows).logits)
    assert (run.predictor(windows).logits.argmax(axis=1) != Intention.OVERTAKE).all()


def test_mirrored_windows_would_show_a_held_out_lane_change() -> None:
    mirrored = {"augment": {"mirror_share": 0.5}}
    with pytest.raises(ValidationError, match="mirror_share"):
        TrainSettings.model_validate({"held_out": "left_lane_change", **mirrored})
    TrainSettings.model_validate({"held_out": "evasive_swerve", **mirrored})


def test_cosine_rises_and_falls_to_nothing(network_run: Run) -> None:
    rates = pd.read_csv(network_run.path / "history.csv")["learning_rate"].to_numpy()
    assert rates[0] > rates[1] > rates[2]
    assert rates[2] == pytest.approx(0, abs=1e-9)


@pytest.mark.slow
def test_two_devices_share_each_batch_and_learn_the_same(records: Records, tmp_path: Path) -> None:
    """Two processes stand for two devices. Without dropout, they differ by rounding and the weighting of classes."""
    history = {}
    for devices in (1, 2):
        optimiser = SMALL_RUN.optimiser.model_copy(update={"accelerator": "cpu", "devices": devices})
        network = SMALL_RUN.of(AsiBipSettings).model_copy(update={"dropout": 0.0})
        loss = SMALL_RUN.loss.model_copy(update={"class_weights": False})
        settings = SMALL_RUN.model_copy(update={"optimiser": optimiser, "asi_bip": network, "loss": loss})
        run = train_records(records, MADE_OF, tmp_path / str(devices), settings)
        history[devices] = pd.read_csv(run.path / "history.csv")
    assert len(history[2]) == len(history[1]) == 3
    np.testing.assert_allclose(history[2]["train_loss"], history[1]["train_loss"], rtol=0.02)
    np.testing.assert_allclose(history[2]["validation_loss"], history[1]["validation_loss"], rtol=0.02)


@pytest.mark.parametrize("count", [1, 2, 3])
@pytest.mark.parametrize("rows", [1, 2, 7])
def test_the_shares_of_the_devices_make_up_the_batch(count: int, rows: int) -> None:
    shares = [Share(rank, count).rows(rows) for rank in range(count)]
    assert all(len(share) for share in shares)
    assert {int(row) for share in shares for row in share} == set(range(rows))
    if rows >= count:
        assert sum(len(share) for share in shares) == rows


def test_a_training_in_bfloat16_answers_in_float32(records: Records, tmp_path: Path) -> None:
    optimiser = SMALL_RUN.optimiser.model_copy(update={"precision": "bf16-mixed", "epochs": 1})
    run = train_records(records, MADE_OF, tmp_path / "run", SMALL_RUN.model_copy(update={"optimiser": optimiser}))
    assert {value.dtype for value in run.predictor.network.parameters()} == {torch.float32}
    assert np.isfinite(run.predictor(windows_of(records, run)).logits).all()


@pytest.mark.parametrize("devices", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_a_training_that_diverges_ends_in_one_line(records: Records, tmp_path: Path, devices: int) -> None:
    """It says where, and what helps; the run is not finished."""
    wild = {"learning_rate": 1e9, "clip_norm": 0.0, "schedule": "constant", "devices": devices}
    content = SMALL_RUN.model_dump()
    settings = TrainSettings.model_validate({**content, "optimiser": {**content["optimiser"], **wild}})
    with pytest.raises(
        RunError,
        match=r"asi-bip: the loss of (validation )?batch \d+ in epoch 1 is (nan|inf): the training stopped; lower "
        r"training\.optimiser\.learning_rate, now 1000000000\.0, and clip gradients \(clip_norm = 1\)$",
    ):
        train_records(records, MADE_OF, tmp_path / "run", settings)
    with pytest.raises(InputError, match="not finished"):
        load_run(tmp_path / "run")


class DivergedPredictor(TreesPredictor):
    """Trees that answer the first window of a batch with NaN."""

    def __call__(self, windows: Windows) -> Outputs:
        outputs = super().__call__(windows)
        outputs.logits[0, 0] = np.nan
        return outputs


def test_answers_that_are_not_finite_are_not_stored(
    records: Records, trees_run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In the evaluation of a run, and at the end of a training whose predictor does not look at its loss."""
    trained = trees_run.predictor
    assert isinstance(trained, TreesPredictor)
    run = replace(trees_run, predictor=DivergedPredictor(trained.trees, trained.tv_rate_hz))
    with pytest.raises(InputError, match="logits are not finite"):
        evaluate_records(run, records, MADE_OF, tmp_path / "evaluation", EvaluateSettings())
    assert not (tmp_path / "evaluation" / PREDICTIONS_FILE).exists()
    monkeypatch.setitem(PREDICTORS._items, "trees", DivergedPredictor)
    settings = SMALL_RUN.model_copy(update={"model": "trees"})
    with pytest.raises(
        RunError, match=r"answers 1 of \d+ windows with values that are not finite; its training diverged"
    ):
        train_records(records, MADE_OF, tmp_path / "run", settings)
    with pytest.raises(InputError, match="not finished"):
        load_run(tmp_path / "run")
