"""Training on streams, from the command line's own entry to a run that is loaded, answers and is refused elsewhere."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import cosim
from isac_cosim.base.errors import InputError
from isac_cosim.labeling.intentions import KNOWN, Intention
from isac_cosim.labeling.streams.dataset import Streams
from isac_cosim.models.hazards.answers import WITH_HAZARD
from isac_cosim.models.hazards.decisions import StreamSide
from isac_cosim.models.hazards.settings import StreamFitSettings
from isac_cosim.models.hazards.targets import targets_of
from isac_cosim.models.hazards.window_networks import AsiBipOnStreams
from isac_cosim.models.inference import Infer
from isac_cosim.models.runs.run import Run, load_run
from isac_cosim.models.runs.settings import TrainSettings
from isac_cosim.models.training.on_streams import train_on_streams
from tests.support.stream_runs import scripted_streams, settings

MODELS = ("trees", "situation", "mixtures", "causal")
NO_LANES = {
    "trees": {"lanes": False},
    "causal": {"lanes": False, "uv": False},
}


@pytest.fixture(scope="module")
def streams(tmp_path_factory: pytest.TempPathFactory) -> Streams:
    return scripted_streams(tmp_path_factory.mktemp("streams"))


@pytest.fixture(scope="module")
def runs(streams: Streams, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Run]:
    folder = tmp_path_factory.mktemp("runs")
    return {model: train_on_streams(streams, folder / model, settings(model)) for model in MODELS}


def side_of(run: Run, streams: Streams, name: str = "train", **changed: object) -> StreamSide:
    card = run.card
    assert card.settings.streams is not None
    of_streams = StreamFitSettings.model_validate(card.settings.streams.model_dump() | changed)
    return StreamSide(streams, frozenset(card.split[name]), of_streams, card.shape, card.settings.windows, 0)


@pytest.mark.parametrize("model", MODELS)
def test_a_trained_run_tells_maneuvers_from_driving(model: str, runs: dict[str, Run], streams: Streams) -> None:
    """On the streams that it was trained on: the odds of a change of lane are higher in one than elsewhere."""
    run = runs[model]
    assert load_run(run.path).card.settings.streams is not None
    left, column = KNOWN.index(Intention.LEFT_LANE_CHANGE), WITH_HAZARD.index(Intention.LEFT_LANE_CHANGE)
    within, elsewhere = [], []
    for batch in side_of(run, streams, hard_share=1.0, easy_share=1.0).batches():
        odds = run.answer(batch.windows).logits[:, left]
        within += odds[batch.targets.interval[:, column] == 0].tolist()
        elsewhere += odds[batch.targets.interval[:, column] == 3].tolist()
    assert len(within) > 5
    assert np.median(within) > np.quantile(elsewhere, 0.9)
    unknown = KNOWN.index(Intention.EVASIVE_SWERVE)
    assert run.answer(batch.windows).probabilities[:, unknown].max() < 1e-6


@pytest.mark.parametrize("model", MODELS)
def test_the_same_training_gives_the_same_files(
    model: str, runs: dict[str, Run], streams: Streams, tmp_path: Path
) -> None:
    again = train_on_streams(streams, tmp_path / "again", settings(model))
    assert again.card.files == runs[model].card.files
    assert again.card.files


def test_a_finished_training_is_opened_and_another_is_refused(runs: dict[str, Run], streams: Streams) -> None:
    run = runs["situation"]
    before = (run.path / "run.json").stat().st_mtime_ns
    assert train_on_streams(streams, run.path, settings("situation")).card == run.card
    assert (run.path / "run.json").stat().st_mtime_ns == before
    with pytest.raises(InputError, match="other settings"):
        train_on_streams(streams, run.path, settings("situation", every_s=0.5))


@pytest.mark.parametrize("model", NO_LANES)
def test_what_a_predictor_does_not_see_does_not_change_its_answers(
    model: str, streams: Streams, tmp_path: Path
) -> None:
    """Without lanes it answers windows whose roads are unknown; without the UV, its reports may say anything."""
    run = train_on_streams(streams, tmp_path / "run", settings(model, **NO_LANES[model]))
    infer = Infer.load(run.path)
    facts, stretches = next(iter(streams.read()))
    tv, uv = stretches[0].window(10, (880, 220), (400.0, 100.0), 0.02)
    side = side_of(run, streams)
    lanes = side.lane_maps(facts.scenario)
    if NO_LANES[model].get("uv", True):
        assert infer(tv, uv).probabilities == pytest.approx(infer(tv, uv, lanes).probabilities)
    else:
        assert infer(tv, uv * 0 + 7, lanes).probabilities == pytest.approx(infer(tv, uv, lanes).probabilities)


def test_every_positive_is_trained_on_and_the_weights_stand_for_all(runs: dict[str, Run], streams: Streams) -> None:
    """Positives and their number against a walk over events; the weights of the others add up to about all of them."""
    side = side_of(runs["trees"], streams, hard_share=0.5, easy_share=0.5, every_s=0.1)
    batches = list(side.batches())
    horizons = side.settings.horizons_s
    positive = sum(int(batch.targets.positive(len(horizons)).sum()) for batch in batches)
    weight = sum(float(batch.weight.sum()) for batch in batches)
    expected, learnt = 0, 0
    for facts, stretches in streams.read(side.episodes):
        for stretch in stretches:
            of_tv = [event for event in facts.events if event.vehicle == stretch.tv_id]
            targets = targets_of(of_tv, stretch.decision_s, horizons, Intention.LEFT_LANE_CHANGE)
            expected += int(targets.positive(len(horizons)).sum())
            learnt += len(stretch.decision_s)
    assert positive == expected > 50
    assert weight == pytest.approx(learnt, rel=0.1)
    assert {float(w) for batch in batches for w in batch.weight} == {1.0, 2.0}


def test_windows_are_those_that_the_streams_give(runs: dict[str, Run], streams: Streams) -> None:
    side = side_of(runs["trees"], streams)
    batch = next(iter(side.batches()))
    assert batch.windows.on_map is not None
    _, stretches = next(iter(streams.read(side.episodes)))
    wanted = batch.windows.on_map.tv[0]
    cut = [stretches[0].window(k, (880, 220), (400.0, 100.0), 0.02)[0] for k in range(len(stretches[0].decision_s))]
    assert any(np.array_equal(wanted, window) for window in cut)


@pytest.mark.parametrize(
    ("model", "given", "message"),
    [
        ("situation", {"lanes": False}, "sees the lanes alone"),
        ("trees", {"least_events": 1000}, "no intention has 1000 events"),
    ],
)
def test_what_cannot_be_learned_is_refused(
    model: str, given: dict[str, object], message: str, streams: Streams, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match=message):
        train_on_streams(streams, tmp_path / "run", settings(model, **given))


def test_longer_windows_than_the_streams_hold_are_refused(streams: Streams, tmp_path: Path) -> None:
    long = TrainSettings.model_validate({"model": "trees", "streams": {}, "windows": {"window_s": 3.0}})
    with pytest.raises(InputError, match=r"hold windows of 2\.2 s"):
        train_on_streams(streams, tmp_path / "run", long)


def test_changed_streams_are_refused(streams: Streams, tmp_path: Path) -> None:
    import shutil

    copy = tmp_path / "copy"
    shutil.copytree(streams.path, copy)
    name = next(iter(copy.glob("stretches/*")))
    name.write_bytes(name.read_bytes()[:-1] + b"x")
    with pytest.raises(InputError, match=name.name):
        train_on_streams(Streams.open(copy), tmp_path / "run", settings("situation"))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({"model": "situation"}, "is trained on streams"),
        ({"model": "rule", "streams": {}}, "is not trained on streams"),
        ({"model": "trees", "streams": {}, "held_out": "overtake"}, "held_out"),
        ({"model": "trees", "streams": {"horizons_s": [1.0, 0.5]}}, "nearest first"),
        ({"model": "treees", "streams": {}}, "did you mean trees"),
    ],
)
def test_settings_that_do_not_fit_are_refused(content: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        TrainSettings.model_validate(content)


def test_settings_of_trainings_on_records_are_written_as_before() -> None:
    assert "streams" not in TrainSettings().model_dump()
    of_streams = TrainSettings.model_validate({"model": "causal", "streams": {}})
    stored = of_streams.model_dump(mode="json")
    assert TrainSettings.model_validate(stored) == of_streams
    assert stored["optimiser"]["learning_rate"] == 2e-3
    on_streams = TrainSettings.model_validate({"model": "asi-bip", "streams": {}})
    assert on_streams.optimiser.epochs == AsiBipOnStreams.optimiser_defaults["epochs"]
    assert TrainSettings().optimiser.epochs == 60


def test_the_command_trains_on_streams_and_says_what_does_not_apply(
    streams: Streams, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The scripted traffic has too few events to learn anything with the default settings, which is said in a line."""
    assert cosim.main(["train", str(streams.path), "-o", str(tmp_path / "a"), "--model", "situation"]) == 2
    assert "generate more streams" in capsys.readouterr().err
    for arguments, message in (
        (["--model", "rule"], "is not trained on streams"),
        (["--model", "trees", "--epochs", "3"], "--epochs applies to networks"),
        (["--held-out", "overtake"], "held_out"),
    ):
        assert cosim.main(["train", str(streams.path), "-o", str(tmp_path / "b"), *arguments]) == 2
        assert message in capsys.readouterr().err


def test_the_card_says_what_was_asked_and_that_nothing_is_held_back(runs: dict[str, Run]) -> None:
    card = json.loads((runs["trees"].path / "run.json").read_text())
    assert card["settings"]["streams"]["horizons_s"] == [0.5, 1.0, 2.0]
    assert card["split"]["test"] == []


@pytest.mark.parametrize(
    ("model", "sees"), [("asi-bip", True), ("castformer", True), pytest.param("asi-bip", False, marks=pytest.mark.slow)]
)
def test_the_papers_networks_train_on_streams(model: str, sees: bool, streams: Streams, tmp_path: Path) -> None:
    """One epoch is enough to see that the network is theirs, and that what is stored answers as what was trained."""
    one = settings(model, lanes=sees, uv=sees).model_dump(mode="json") | {"optimiser": {"epochs": 1, "batch": 64}}
    run = train_on_streams(streams, tmp_path / "run", TrainSettings.model_validate(one))
    batch = next(iter(side_of(run, streams).batches()))
    assert load_run(run.path).answer(batch.windows).logits == pytest.approx(run.answer(batch.windows).logits)
    assert run.card.parameters is not None
    assert run.card.parameters > 10_000
