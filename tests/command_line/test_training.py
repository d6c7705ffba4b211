"""`cosim train` on the command line: what it warns of, and that a refusal stands alone."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pandas as pd
import pytest

import cosim
from isac_cosim.base.feedback import Feedback, Foreword
from isac_cosim.command_line import training
from isac_cosim.models.networks.fitting import CHECKPOINTS, LOGS
from isac_cosim.models.predictors.aligned import AlignedSettings
from isac_cosim.models.runs.run import CARD_FILE, read_card
from tests.support.forged import forge_dataset
from tests.support.made_up_dataset import write_dataset


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a dataset of few windows, so that scores will lack something."""
    write_dataset(tmp_path / "data", seeds=3, per_class=1)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def foreign_folder(folder: Path) -> None:
    (folder / "new").mkdir()
    (folder / "new" / "thesis.tex").touch()


def damaged_shard(folder: Path) -> None:
    shard = sorted((folder / "data" / "shards").iterdir())[0]
    content = bytearray(shard.read_bytes())
    middle = len(content) // 2
    content[middle : middle + 100] = bytes(100)
    shard.write_bytes(content)
    forge_dataset(folder / "data")


def damaged_card(folder: Path) -> None:
    (folder / "new").mkdir()
    (folder / "new" / CARD_FILE).write_text("{")


def damaged_checkpoint(folder: Path) -> None:
    assert cosim.main(["train", "data", "-o", "new", "--epochs", "1", "--quiet"]) == 0
    card = folder / "new" / CARD_FILE
    (folder / "new" / CHECKPOINTS / "last.ckpt").write_bytes(b"PK")
    card.unlink()


@pytest.mark.parametrize("fault", [foreign_folder, damaged_shard, damaged_card, damaged_checkpoint])
def test_what_is_refused_is_told_in_one_line(
    folder: Path, capfd: pytest.CaptureFixture[str], fault: Callable[[Path], None]
) -> None:
    fault(folder)
    capfd.readouterr()
    assert cosim.main(["train", "data", "-o", "new", "--epochs", "1", "--quiet"]) == 2
    (line,) = capfd.readouterr().err.splitlines()
    assert line.startswith("cosim: ")


@pytest.mark.parametrize("model", ["rule", "asi-bip"])
def test_a_training_still_warns_of_what_its_scores_lack(
    folder: Path, capfd: pytest.CaptureFixture[str], model: str
) -> None:
    """Whether it reports progress or not, and also where it had already finished."""
    for _ in range(2):
        command = ["train", "data", "-o", "new", "--model", model, "--quiet"]
        assert cosim.main(command + (["--epochs", "1"] if model == "asi-bip" else [])) == 0
        lines = capfd.readouterr().err.splitlines()
        assert lines
        assert all(line.startswith("warning: ") for line in lines)


def test_a_training_on_a_share_of_the_seeds_leaves_the_others_unused(
    folder: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    command = ["train", "data", "-o", "new", "--model", "rule", "--quiet", "--training-share"]
    for share in ("1.5", "0", "nan"):
        assert cosim.main([*command, share]) == 2
        assert f"--training-share {share}: give a share" in capfd.readouterr().err
    write_dataset(folder / "more", seeds=6, per_class=1)
    command[1] = "more"
    assert cosim.main([*command, "0.5"]) == 0
    split = read_card(folder / "new").split
    assert split["train"]
    assert split["unused"]


def test_a_study_gives_the_settings_that_no_option_names(folder: Path) -> None:
    text = "model = 'aligned'\nseed = 3\naligned.hidden = 8\noptimiser = { epochs = 1, learning_rate = 0.01 }"
    (folder / "study.toml").write_text(f"[training]\n{text}")
    command = ["train", "data", "--quiet", "--study", "study.toml", "-o"]
    assert cosim.main([*command, "new"]) == 0
    settings = read_card(folder / "new").settings
    assert (settings.model, settings.seed, settings.optimiser.learning_rate) == ("aligned", 3, 0.01)
    assert settings.of(AlignedSettings).hidden == 8
    assert cosim.main([*command, "trees", "--model", "trees", "--seed", "4"]) == 0
    settings = read_card(folder / "trees").settings
    assert (settings.model, settings.seed) == ("trees", 4)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[dataset]", "study.toml: has no section [training]"),
        ("training = 3", "study.toml: has no section [training]"),
        ("[training.streams]\nuv = false", "study.toml: has [training.streams], and this is a dataset of records"),
        ("[training]\nmodle = 'trees'", "study.toml, [training]: modle: unknown key"),
        ("[training]\noptimiser = 3", "study.toml, [training]: optimiser"),
        ("[training]\nmodel = ['trees']", "study.toml, [training]: model"),
    ],
)
def test_a_study_without_settings_of_this_training_is_refused(
    folder: Path, capfd: pytest.CaptureFixture[str], text: str, said: str
) -> None:
    (folder / "study.toml").write_text(text)
    assert cosim.main(["train", "data", "--quiet", "--study", "study.toml", "-o", "new"]) == 2
    assert said in capfd.readouterr().err


def test_a_foreword_comes_once_and_before_the_first_report() -> None:
    said: list[str] = []

    class Listening(Feedback):
        def message(self, line: str) -> None:
            said.append(line)

    foreword = Foreword(Foreword(Listening(), ["a"]), ["b"], said.append)
    with foreword.bar("work") as move:
        assert said == []
        move(1, 2)
    foreword.message("c")
    foreword.say()
    assert said == ["b", "a", "c"]


def test_every_epoch_says_what_it_has_taught(folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """In lines that stay; the scores are those of the history."""
    assert cosim.main(["train", "data", "-o", "new", "--epochs", "2"]) == 0
    lines = [line for line in capfd.readouterr().err.splitlines() if line.startswith("asi-bip, epoch ")]
    history = pd.read_csv(folder / "new" / "history.csv")
    scores, best = history["validation_macro_f1"], history["validation_macro_f1"].cummax()
    assert len(lines) == len(history) == 2
    for k, line in enumerate(lines):
        assert line.startswith(f"asi-bip, epoch {k + 1}/2: validation macro-F1 {scores[k]:.3f}")
        assert f", best {best[k]:.3f}; training loss {history['train_loss'][k]:.3g}" in line


@pytest.mark.slow
def test_curves_are_logged_for_tensorboard(folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """They are those of the history, and the training is the same as without."""
    accumulator = pytest.importorskip("tensorboard.backend.event_processing.event_accumulator")
    assert cosim.main(["train", "data", "-o", "logged", "--epochs", "2", "--log", "tensorboard"]) == 0
    assert "tensorboard --logdir logged shows the curves" in capfd.readouterr().err
    events = accumulator.EventAccumulator(str(folder / "logged" / LOGS)).Reload()
    history = pd.read_csv(folder / "logged" / "history.csv")
    for name in ("validation_macro_f1", "train_loss"):
        logged = [event.value for event in events.Scalars(name)]
        assert logged == pytest.approx(history[name].tolist(), rel=1e-6)
    assert cosim.main(["train", "data", "-o", "plain", "--epochs", "2", "--quiet"]) == 0
    assert (folder / "plain" / "weights.pt").read_bytes() == (folder / "logged" / "weights.pt").read_bytes()


@pytest.mark.parametrize(
    ("options", "installed", "line"),
    [
        (["--log", "tensorboard"], False, "--log tensorboard needs TensorBoard: pip install '.[tensorboard]'"),
        (["--log", "wandb"], True, "--log 'wandb': curves can be logged for tensorboard alone"),
        (["--log", "tensorboard", "--model", "trees"], True, "--log applies to networks"),
        (["--log", "tensorboard", "--model", "treees"], True, "did you mean trees?"),
    ],
)
def test_what_cannot_be_logged_is_refused_before_anything_is_written(
    folder: Path,
    capfd: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    options: list[str],
    installed: bool,
    line: str,
) -> None:
    monkeypatch.setattr(training, "find_spec", lambda _: object() if installed else None)
    assert cosim.main(["train", "data", "-o", "new", *options]) == 2
    error = capfd.readouterr().err
    assert error.count("\n") == 1
    assert line in error
    assert not (folder / "new").exists()
