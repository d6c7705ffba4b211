"""Reproduces a paper: its cost, its stages, and the page that stands at their end."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from isac_cosim.base.errors import InputError
from isac_cosim.base.feedback import SILENT, Feedback
from isac_cosim.base.files import write_json
from isac_cosim.base.registry import nearest
from isac_cosim.base.settings import Settings, merged
from isac_cosim.base.workers.engine import Engine, LocalEngine
from isac_cosim.base.workers.kept_workers import kept_running
from isac_cosim.evaluation.report.parts import Part
from isac_cosim.evaluation.report.replay.content import Replay
from isac_cosim.studies.clip_validation import background_of
from isac_cosim.studies.reproduction.asi_bip import stages as asi_bip
from isac_cosim.studies.reproduction.asi_bip.report import asi_bip_parts
from isac_cosim.studies.reproduction.castformer import stages as castformer
from isac_cosim.studies.reproduction.castformer.clips import clips_in
from isac_cosim.studies.reproduction.castformer.report import castformer_parts
from isac_cosim.studies.reproduction.experiments.pages import CLAIMS, write_pages
from isac_cosim.studies.reproduction.experiments.sizes import (
    ASI_BIP,
    CASTFORMER,
    AsiBipSize,
    CastformerSize,
    SizeName,
)
from isac_cosim.studies.reproduction.experiments.stages import (
    Capacity,
    Cost,
    Stage,
    chosen_stages,
    cost_of,
    fastest,
    identity_of,
    in_full,
    run_stages,
)
from isac_cosim.studies.reproduction.experiments.verdicts import Claim

PAPERS = (asi_bip.PAPER, castformer.PAPER)


class Reproduction(Protocol):
    """The experiments of a paper."""

    def stages(self) -> list[Stage]:
        """Return all stages, in order."""

    def replay(self) -> Replay | None:
        """Return the replay of an episode that a trained network was tested on; None before there is one."""


@dataclass(frozen=True)
class Request:
    """What to reproduce.

    paper: one of PAPERS. size: name of the size. settings: the size itself. out: folder to write. stages: names or
    groups of the stages to run, all if None. clips: folder of feature files for CaSTFormer, None for windows.
    background: the class of the clips that drives straight on, or `none`; None where their files say.
    """

    paper: str
    size: str
    settings: AsiBipSize | CastformerSize
    out: Path
    stages: Sequence[str] | None = None
    clips: Path | None = None
    background: str | None = None

    def reproduction(self, engine: Engine, feedback: Feedback) -> Reproduction:
        """Return the experiments of the paper."""
        if isinstance(self.settings, AsiBipSize):
            return asi_bip.AsiBipReproduction(self.settings, self.out, engine, feedback)
        return castformer.CastformerReproduction(self.settings, self.out, engine, feedback, self.clips, self.background)


class ReproductionResult(Settings):
    """What a reproduction came to: its page, the verdict on each claim, and the stages that were not run."""

    page: Path
    claims: list[Claim]
    not_run: list[str]


def request(
    paper: str,
    out: Path,
    quick: bool = False,
    stages: Sequence[str] | None = None,
    clips: Path | None = None,
    epochs: int | None = None,
    background: str | None = None,
) -> Request:
    """Return what to reproduce. Raises InputError for another paper, or for clips of a paper that has none.

    epochs: of every network of the paper, in place of those of the size. background: as in `Request`.
    """
    if paper not in PAPERS:
        raise InputError(f"{paper}: no such paper; {nearest(paper, PAPERS)}choose {' or '.join(PAPERS)}")
    if clips is not None and paper != castformer.PAPER:
        raise InputError(f"--clips applies to {castformer.PAPER} only; remove it")
    if background is not None and clips is None:
        raise InputError("--background names a class of the clips; give --clips FOLDER, or remove it")
    if clips is not None:
        background_of(clips_in(clips), background)
    size: SizeName = "quick" if quick else "full"
    sizes: Mapping[SizeName, AsiBipSize | CastformerSize] = ASI_BIP if paper == asi_bip.PAPER else CASTFORMER
    settings = sizes[size]
    if epochs is not None:
        training = merged(settings.training, {"optimiser": {"epochs": epochs, "patience": epochs}})
        changed = settings.model_dump() | {"training": training}
        if isinstance(settings, AsiBipSize):
            changed["literal_epochs"] = min(epochs, settings.literal_epochs)
        settings = type(settings).model_validate(changed)
    return Request(paper, size, settings, out, stages, clips, background)


def expected_cost(wanted: Request, engine: Engine) -> Cost:
    """Return what a reproduction still costs. Raises InputError for stages that there are not."""
    stages = chosen_stages(wanted.reproduction(engine, SILENT).stages(), wanted.stages)
    return cost_of(stages, wanted.out, _capacity(engine))


def best_workers(wanted: Request, cores: int) -> int:
    """Return how many local workers make a reproduction short on that many cores.

    Three trainings on two cores take one and a half rounds side by side, and two rounds on two workers.
    """
    stages = wanted.reproduction(LocalEngine(cores), SILENT).stages()
    return fastest(in_full(chosen_stages(stages, wanted.stages), wanted.out), cores).workers


def reproduce(wanted: Request, engine: Engine, feedback: Feedback = SILENT) -> ReproductionResult:
    """Run the stages of a paper that are not finished, and write the page of all that are.

    engine: runs episodes, sensing and trainings. feedback: where the cost and the progress are reported.
    Raises InputError where the folder holds something else, RunError where a stage fails.
    """
    content: dict[str, Any] = wanted.settings.model_dump(mode="json")
    if wanted.clips is not None:
        content["clips"] = str(wanted.clips.resolve())
        content["background"] = background_of(clips_in(wanted.clips), wanted.background)
    identity = identity_of(wanted.paper, wanted.size, content)
    with kept_running(engine) as workers:
        reproduction = wanted.reproduction(workers, feedback)
        stages = reproduction.stages()
        chosen = chosen_stages(stages, wanted.stages)
        capacity = _capacity(engine)
        run_stages(identity, chosen, wanted.out, capacity, feedback, stages)
        replay = reproduction.replay()
    missing = [stage for stage in stages if stage.name in cost_of(stages, wanted.out, capacity).stages]
    parts, claims = _parts(wanted)
    write_json(wanted.out / f"{CLAIMS}.json", [claim.model_dump(mode="json") for claim in claims])
    not_run = [f"{stage.name}: {stage.question}" for stage in missing]
    page = write_pages(TITLES[wanted.paper], identity, parts, not_run, wanted.out, claims, replay)
    return ReproductionResult(page=page, claims=claims, not_run=[stage.name for stage in missing])


def _capacity(engine: Engine) -> Capacity:
    return Capacity(engine.workers, engine.cores)


def _parts(wanted: Request) -> tuple[list[Part], list[Claim]]:
    if isinstance(wanted.settings, AsiBipSize):
        return asi_bip_parts(wanted.out, wanted.settings)
    return castformer_parts(wanted.out)


TITLES = {
    asi_bip.PAPER: "ASI-BIP, reproduced",
    castformer.PAPER: "CaSTFormer, reproduced",
}
"""Title of each paper's page."""
