"""Training on several devices of this machine, whose processes nobody else can join.

By default the processes meet at a port that listens on every network interface and answers everyone.
"""

from __future__ import annotations

import logging
import os
import warnings
from pathlib import Path

import psutil
import torch.distributed
from lightning.pytorch.strategies import DDPStrategy

from isac_cosim.base.errors import RunError

MEETING_FILE = "meeting"
SOCKET_INTERFACES = ("GLOO_SOCKET_IFNAME", "NCCL_SOCKET_IFNAME")
"""Environment variables that say on which network interface the processes exchange gradients."""


class PrivateDDP(DDPStrategy):
    """One process a device. They meet in a file, and exchange gradients through the machine's own interface.

    folder: for the file; only this user may read it, and it exists as long as the training runs.
    """

    def __init__(self, folder: Path) -> None:
        super().__init__(start_method="spawn")
        self._meeting = folder / MEETING_FILE

    def setup_distributed(self) -> None:
        """Join the other processes. Runs in each of them."""
        quieten()
        self.set_world_ranks()
        os.environ.update(dict.fromkeys(SOCKET_INTERFACES, _own_interface()))
        torch.distributed.init_process_group(
            self._get_process_group_backend(),
            init_method=self._meeting.as_uri(),
            rank=self.global_rank,
            world_size=self.world_size,
        )
        # What is left to set up; it finds that the processes have met.
        super().setup_distributed()


def quieten() -> None:
    """Silence Lightning's hints on devices, workers and data loaders in a process of its own."""
    for name in ("lightning.pytorch", "lightning.fabric", "lightning"):
        logging.getLogger(name).setLevel(logging.ERROR)
    warnings.filterwarnings("ignore", module=r"lightning.*|torch\..*")


def _own_interface() -> str:
    """Return the network interface that leads to this machine alone."""
    for name, addresses in psutil.net_if_addrs().items():
        if any(address.address == "127.0.0.1" for address in addresses):
            return str(name)
    raise RunError("no network interface leads to this machine (127.0.0.1); train on one device")
