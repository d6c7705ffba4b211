"""How a scene is sensed: waveform and power, how often, and how detections find their vehicles."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

from pydantic import Field

from isac_cosim.base.settings import Settings
from isac_cosim.isacsim.radio.channel import ChannelSettings
from isac_cosim.isacsim.radio.waveform import Waveform
from isac_cosim.isacsim.tracking.kalman import TrackingSettings
from isac_cosim.isacsim.traffic.motion import MotionSettings

NumerologyName = Literal["nr100", "paper"]


@dataclass(frozen=True)
class Numerology:
    """A waveform and the power that it is sent with. power_dbm: over the whole bandwidth."""

    waveform: Waveform
    power_dbm: float


NUMEROLOGIES: dict[NumerologyName, Numerology] = {
    "nr100": Numerology(Waveform(subcarriers=3276, symbols=40, symbol_s=0.5e-3, antennas=16), power_dbm=46.0),
    "paper": Numerology(Waveform(), power_dbm=29.8),
}
"""nr100: the widest channel of NR below 6 GHz at 30 kHz, 273 resource blocks (3GPP TS 38.101-1, 5.3.2), with one
sensing symbol in each of 40 slots; cells of 0.125 of the sine, 1.5 m and 2.1 m/s. paper: the snapshot of ASI-BIP; cells
of 0.25, 39 m and 28.6 m/s."""


class SceneSettings(Settings):
    """How the panels sense all vehicles at once. The channel is the link budget, with the numerology's power."""

    association: Literal["tracks", "truth"] = Field(
        "tracks",
        description="How detections find their vehicles: by the network's own tracks, or, to compare with, by the "
        "vehicles' true motion.",
    )
    begin: Literal["found", "followed"] = Field(
        "found",
        description="How the network knows who is there when the episode begins. found: it begins without a track. "
        "followed: it has followed them before, and has a track of each that two masts see, with errors as large as "
        "is usual.",
    )
    bodies: Literal["points", "bodies"] = Field(
        "bodies",
        description="What echoes of a vehicle. points: one at its front bumper, with nothing else around. bodies: "
        "five of its body (3GPP TR 38.901), which hide what is behind them and stand before a background.",
    )
    blockage: bool = Field(True, description="Whether bodies hide what is behind them (3GPP TR 37.885).")
    background_points: int = Field(
        10,
        ge=0,
        le=200,
        description="With bodies, what stands beside the road and echoes: so many points in each panel's view.",
    )
    background_dbsm: float = Field(10.0, ge=-50, le=60, description="Mean cross-section of each of them, dBsm.")
    residual_db: float = Field(
        -40.0,
        ge=-200,
        le=0,
        description="What is left of the background's echoes once the background, learned over minutes, is subtracted.",
    )
    numerology: NumerologyName = Field(
        "nr100",
        description="Waveform and power. nr100: 100 MHz, 40 symbols one a slot, 16 antennas, 46 dBm. paper: 3.84 MHz, "
        "42 symbols in a row, 8 antennas, 29.8 dBm.",
    )
    power_dbm: float | None = Field(
        None, ge=-200, le=200, description="Transmit power over the bandwidth; the numerology's if absent."
    )
    fixes_hz: float = Field(25.0, ge=1.0, le=100.0, description="How often the panels sense.")

    @property
    def sent(self) -> Numerology:
        """The waveform of the numerology, with the power that it is sent with here."""
        chosen = NUMEROLOGIES[self.numerology]
        return chosen if self.power_dbm is None else replace(chosen, power_dbm=self.power_dbm)


@dataclass(frozen=True)
class SceneSetup:
    """Everything that a scene depends on besides the traffic and the sites.

    scene: its own settings. channel: of kind `link`; its power is the numerology's. tracking: the filter's model of how
    vehicles move. motion: how recorded positions are conditioned. range_m, half_width_deg: what a panel sees.
    target_height_m: of the reflecting point above the road. false_alarm: probability that noise alone makes a detection
    of a panel in one fix.
    """

    scene: SceneSettings
    channel: ChannelSettings
    tracking: TrackingSettings
    motion: MotionSettings
    range_m: float = 350.0
    half_width_deg: float = 60.0
    target_height_m: float = 0.8
    false_alarm: float = 1e-3

    @property
    def numerology(self) -> Numerology:
        """Waveform and power."""
        return self.scene.sent
