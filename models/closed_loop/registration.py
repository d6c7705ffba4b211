"""Registers the closed loop with Gymnasium, which calls `register` by itself once the package is installed."""

from __future__ import annotations

ENVIRONMENT = "isac_cosim/Advisory-v0"


def register() -> None:
    """Make `gymnasium.make(ENVIRONMENT)` work. Nothing but a name is imported until an environment is made."""
    from gymnasium.envs.registration import register as register_environment
    from gymnasium.envs.registration import registry

    if ENVIRONMENT not in registry:
        register_environment(ENVIRONMENT, entry_point="models.closed_loop.environment:AdvisoryEnv")
