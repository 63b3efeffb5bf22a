"""One process or several: what `torchrun` started works on one training together."""

from __future__ import annotations

import os
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass

import torch
from torch import distributed, nn
from torch.nn.parallel import DistributedDataParallel

from ..errors import InputError


@dataclass(frozen=True)
class Workers:
    """rank of this process among `count`; the first writes."""

    rank: int
    count: int
    device: torch.device

    @property
    def first(self) -> bool:
        return self.rank == 0

    def share(self, batch: int) -> int:
        """This process's part of a batch. Raises InputError where it cannot be divided."""
        if batch % self.count:
            raise InputError(
                f"a batch of {batch} cannot be divided among {self.count} processes; change optimiser.batch"
            )
        return batch // self.count

    def wrap(self, system: nn.Module, *, partly: bool = False) -> nn.Module:
        """The system with its gradients averaged over the processes.

        partly: not every value has a gradient in every update.
        """
        if self.count == 1:
            return system
        ids = [self.device.index] if self.device.type == "cuda" else None
        # each process sets what follows from PSFs by itself, in the light of its own photos
        own = [
            f"{place}.{name}"
            for place, module in system.named_modules()
            for name in getattr(module, "psf_buffers", ())
        ]
        DistributedDataParallel._set_params_and_buffers_to_ignore_for_model(system, own)
        return DistributedDataParallel(system, device_ids=ids, find_unused_parameters=partly)

    def agree(self, value: float) -> float:
        """The same number in every process: the largest, and not a number where it is so in any."""
        if self.count == 1:
            return value
        values = [torch.zeros(1, dtype=torch.float64, device=self.device) for _ in range(self.count)]
        distributed.all_gather(values, torch.tensor([value], dtype=torch.float64, device=self.device))
        return float(torch.cat(values).max())


@contextmanager
def join_workers(device: str, wanted: str = "auto") -> Generator[Workers]:
    """The processes of this training.

    device: from the command line, `wanted`: from the recipe; the first that is not auto counts.

    Raises InputError where CUDA is asked for and there is none.
    """
    rank, count = int(os.environ.get("RANK", 0)), int(os.environ.get("WORLD_SIZE", 1))
    local = int(os.environ.get("LOCAL_RANK", 0))
    chosen = choose_device(wanted if device == "auto" else device, local)
    if count == 1:
        yield Workers(0, 1, chosen)
        return
    distributed.init_process_group("nccl" if chosen.type == "cuda" else "gloo")
    try:
        yield Workers(rank, count, chosen)
    finally:
        distributed.destroy_process_group()


def choose_device(wanted: str, index: int = 0) -> torch.device:
    """`auto`, `cpu` or `cuda`. Raises InputError where CUDA is asked for and there is none."""
    if wanted == "cuda" and not torch.cuda.is_available():
        raise InputError(
            "the recipe or --device asks for CUDA, and PyTorch finds none here; "
            "use --device cpu, or install a CUDA build of PyTorch and its driver"
        )
    if wanted == "cpu" or not torch.cuda.is_available():
        return torch.device("cpu")
    return torch.device("cuda", index)
