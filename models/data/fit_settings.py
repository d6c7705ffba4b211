"""The settings of a training that no predictor owns: windows, split, variation, loss and optimiser."""

from __future__ import annotations

from typing import Annotated, Literal, Self, TypeVar

from pydantic import Field, model_validator

from isac_cosim.base.setting_fields import Seed
from isac_cosim.base.settings import Settings
from isac_cosim.labeling.intentions import LANE_CHANGES, Intention
from isac_cosim.models import DEFAULT
from isac_cosim.models.data.augment import AugmentSettings
from isac_cosim.models.data.pre_onset import PreOnsetSettings
from isac_cosim.models.data.split import SplitSettings
from isac_cosim.models.data.windows import WindowSettings

HeldOut = Literal["hard_brake", "left_lane_change", "right_lane_change", "overtake", "hard_accel", "evasive_swerve"]
Section = TypeVar("Section", bound=Settings)


DecayRate = Annotated[float, Field(ge=0, lt=1)]
"""Share of a moment estimate that a step keeps."""


class OptimiserSettings(Settings):
    """AdamW and its learning-rate schedule.

    The defaults of learning rate, betas and batch size are those of the ASI-BIP paper. A predictor may have optimiser
    defaults of its own (`Predictor.optimiser_defaults`): they replace the defaults here wherever the user does not set
    the key, in `cosim train` and in a study alike. The run's card stores the values that were used.
    """

    epochs: int = Field(60, ge=1, le=1_000_000, description="maximum number of epochs")
    batch: int = Field(32, ge=1, le=1_000_000, description="windows per optimiser step")
    learning_rate: float = Field(1e-4, gt=0, le=1e9, description="learning rate; with the cosine schedule, its peak")
    betas: tuple[DecayRate, DecayRate] = Field((0.9, 0.999), description="decay rates of the two moment estimates")
    weight_decay: float = Field(0.0, ge=0, le=1e3, description="decoupled weight decay")
    schedule: Literal["constant", "cosine"] = Field(
        "constant", description="cosine: linear warm-up, then half a cosine down to 0"
    )
    warmup_share: float = Field(0.1, ge=0, lt=1, description="share of all steps spent on the warm-up")
    clip_norm: float = Field(
        1.0, ge=0, le=1e9, description="gradients are scaled down to this norm; 0 turns clipping off"
    )
    patience: int = Field(
        12, ge=1, le=1_000_000, description="epochs without a better validation macro-F1 before training stops"
    )
    threads: int = Field(2, ge=1, le=1024, description="CPU threads; the last digits of a result depend on it")
    accelerator: Literal["auto", "cpu", "gpu"] = Field(
        "auto",
        description="where networks are trained; auto: on a GPU if there is one. The last digits depend on it",
    )
    devices: int = Field(
        1, ge=1, le=1024, description="processors or GPUs that share each batch of a network's training"
    )
    precision: Literal["32-true", "bf16-mixed", "16-mixed"] = Field(
        "32-true", description="number format in which networks are trained; predictions are always in float32"
    )


class LossSettings(Settings):
    """Parameters of the focal loss, and of outlier exposure."""

    gamma: float = Field(2.0, ge=0, le=100, description="focusing parameter; 0 gives weighted cross-entropy")
    exposure_weight: float = Field(
        0.0,
        ge=0,
        le=1e6,
        description="weight of outlier exposure, which makes all intentions equally likely on pre-onset windows; "
        "0 turns it off",
    )
    class_weights: bool = Field(True, description="weight classes by inverse frequency; otherwise all weigh 1")


class FitSettings(Settings):
    """What every predictor is given when it is trained.

    The settings of the predictors themselves are in sections of their own: `of` returns one by its class. Use
    `models.runs.settings.TrainSettings`, which knows the sections of all registered predictors.
    """

    model: str = Field(DEFAULT, description="name of the predictor")
    seed: Seed = Field(0, description="seed of initial weights, window ends and batches")
    held_out: HeldOut | None = Field(
        None, description="known intention left out of training; evaluation then treats it as unknown"
    )
    windows: WindowSettings = WindowSettings()
    split: SplitSettings = SplitSettings()
    ends_per_record: int = Field(1, ge=1, le=10_000, description="windows drawn from each record, anew in every epoch")
    validation_ends: int = Field(2, ge=1, le=10_000, description="fixed windows per validation record")
    pre_onset: PreOnsetSettings = PreOnsetSettings()
    augment: AugmentSettings = AugmentSettings()
    loss: LossSettings = LossSettings()
    optimiser: OptimiserSettings = Field(OptimiserSettings(), validate_default=True)

    @model_validator(mode="after")
    def _frame_can_turn(self) -> Self:
        if self.augment.turns_frame and self.windows.frame == "absolute":
            raise ValueError(
                "augment turns or mirrors windows, which an absolute frame does not allow: choose another windows.frame"
            )
        return self

    @model_validator(mode="after")
    def _held_out_stays_unseen(self) -> Self:
        if self.augment.mirror_share and self.left_out in LANE_CHANGES:
            raise ValueError(
                f"held_out {self.held_out}: mirrored lane changes would show it in training; set augment.mirror_share 0"
            )
        return self

    @property
    def left_out(self) -> Intention | None:
        """The intention that is held out, or None."""
        return None if self.held_out is None else Intention[self.held_out.upper()]

    def of(self, settings_class: type[Section]) -> Section:
        """Return the section of a predictor, given the class of its settings. Raises LookupError if there is none."""
        for section in (self.model_extra or {}).values():
            if type(section) is settings_class:
                return section
        raise LookupError(f"no section of {settings_class.__name__} in the settings of {self.model}")
