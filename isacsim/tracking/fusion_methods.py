"""The fusion methods by name, and the settings that choose one.

To add a method, write a callable that fulfils `isacsim.tracking.fusion.FusionMethod`, and give it a line below or, in a
package of its own, an entry point of GROUP.
"""

from __future__ import annotations

from typing import Annotated

from pydantic import AfterValidator, Field

from isac_cosim.base.registry import Registry
from isac_cosim.isacsim.tracking.fusion import FusionMethod, FusionOptions, fuse
from isac_cosim.isacsim.tracking.fusion_tdoa_aoa import fuse_eq5

GROUP = "isac_cosim.fusion_methods"
FUSION_METHODS: Registry[FusionMethod] = Registry(
    "fusion method",
    {
        "information": fuse,
        "eq5": fuse_eq5,
    },
    GROUP,
)


class FusionSettings(FusionOptions):
    """How several sites' measurements become one fix."""

    method: Annotated[str, AfterValidator(FUSION_METHODS.check)] = Field(
        "information",
        description="information: joint maximum likelihood. eq5: the paper's linear equations (fusion_tdoa_aoa).",
    )
