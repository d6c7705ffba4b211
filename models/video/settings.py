"""How a pair of videos becomes a clip."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from isac_cosim.base.setting_fields import Seed
from isac_cosim.base.settings import Settings

Pixels = Annotated[int, Field(ge=1, le=10_000)]
Corner = Annotated[int, Field(ge=0, le=10_000)]
Width = Annotated[int, Field(ge=1, le=512)]


class VideoSettings(Settings):
    """How a pair of videos becomes a clip. Sizes are width and height.

    The paper (CaSTFormer, "Data Preparation") gives frames, length, sizes and widths. It does not say where in the
    picture the driver is cut out, whether its "900 x 800" begins with the width (it is read so, as its "144 x 96"
    does), how a flow becomes a picture, or how speeds are smoothed.
    """

    frames: int = Field(150, ge=2, le=10_000, description="frames of a clip, evenly spaced in time")
    clip_s: float = Field(5.0, gt=0, le=600, description="length of a clip, s; it ends at the maneuver")
    tolerance_s: float = Field(
        0.1, ge=0, le=10, description="how much a video may be shorter than a clip, or than the other view, s"
    )
    driver_cut: tuple[Pixels, Pixels] = Field((900, 800), description="part of the driver's view that is used, pixels")
    driver_corner: tuple[Corner, Corner] | None = Field(
        None, description="its upper left corner, from the left and from the top, pixels; null for the middle"
    )
    driver_size: int = Field(112, ge=112, le=112, description="side of the picture that the face network gets, pixels")
    flow_size: tuple[Pixels, Pixels] = Field((288, 192), description="size at which optical flow is measured, pixels")
    road_size: tuple[Pixels, Pixels] = Field((144, 96), description="size of the flow that ResNet-18 gets, pixels")
    driver_width: Width = Field(64, description="features of the driver's view in a frame, without the speed")
    road_width: Width = Field(32, description="features of the road in a frame, without the speed")
    speed_mean_s: float = Field(
        1.0, ge=0, le=600, description="speeds are means over so much time before a frame, s, so none is of later"
    )
    speed_known: float = Field(0.5, gt=0, le=1, description="least share of frames whose speed is known")
    seed: Seed = Field(0, description="seed of random weights and projections")

    @property
    def rate_hz(self) -> float:
        """Frames of a clip in a second."""
        return self.frames / self.clip_s
