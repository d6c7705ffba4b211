"""Importing this registers the closed loop with Gymnasium as `isac_cosim/Advisory-v0`; see docs/closed_loop.md.

Gymnasium imports it by itself where it is named in front: `gymnasium.make("isac_cosim.gym:isac_cosim/Advisory-v0")`.
Nothing else of the tool is imported before an environment is made.
"""

from __future__ import annotations

try:
    from gymnasium.envs.registration import register
except ModuleNotFoundError as error:
    raise ModuleNotFoundError(
        "isac_cosim.gym needs Gymnasium: run `pip install '.[gym]'` in a checkout", name=error.name
    ) from None

ENVIRONMENT = "isac_cosim/Advisory-v0"

register(ENVIRONMENT, entry_point="isac_cosim.evaluation.closed_loop.environment.advisory_env:AdvisoryEnv")
