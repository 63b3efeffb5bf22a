"""A network of the user's own: any PyTorch module from photos [batch, 3, y, x] to images of that shape.

Its checkpoint holds the name of its class, `module:Class`, and what the class is called with. Nothing is
imported on the word of a file: the class's module is one that is imported already, as those are that the
variable EDOFSIM_PLUGINS names (`core.registry`).
"""

from __future__ import annotations

import inspect
import json
import sys
from collections.abc import Mapping
from pathlib import Path

import torch
from torch import Tensor, nn
from torch.nn import functional

from ..core.registry import TRIED
from ..errors import InputError
from .restorer import Restorer

MULTIPLE = 32
"""Pixels: networks that halve photos see sides that can be halved five times."""
PLAIN = (bool, int, float, str, list, tuple)


class OwnNetwork(Restorer):
    """A module of the class `of`, called with `settings`.

    network: the module itself, where it is there.
    """

    kind = "own"

    def __init__(
        self, of: str, settings: Mapping[str, object] | None = None, network: nn.Module | None = None
    ) -> None:
        super().__init__()
        self.of, self.called_with = of, dict(settings or {})
        self.network = _class_of(of)(**self.called_with) if network is None else network

    @classmethod
    def around(cls, network: nn.Module, settings: Mapping[str, object] | None = None) -> OwnNetwork:
        """A module that there is.

        settings: what its class is called with to build such a one, JSON values; None: its attributes of the
            same names.

        Raises InputError where that builds another one.
        """
        kind = type(network)
        of = f"{_module_name(kind.__module__)}:{kind.__qualname__}"
        if settings is None:
            values = {name: getattr(network, name, None) for name in inspect.signature(kind).parameters}
            settings = {name: value for name, value in values.items() if isinstance(value, PLAIN)}
        advice = "say what its class is called with, settings={...}, for its checkpoint to be read again"
        try:
            settings = json.loads(json.dumps(dict(settings)))
            with torch.random.fork_rng(devices=[]):
                again = cls(of, settings)
        except (TypeError, ValueError, RuntimeError) as error:
            raise InputError(
                f"the network {of} cannot be built from {settings} ({error}): {advice}"
            ) from None
        shapes, others = (
            {name: value.shape for name, value in each.state_dict().items()}
            for each in (network, again.network)
        )
        if shapes != others:
            raise InputError(f"{of} with {settings} has weights of other shapes than the network: {advice}")
        return cls(of, settings, network)

    def settings(self) -> dict[str, object]:
        return {"of": self.of, "settings": self.called_with}

    def forward(self, photo: Tensor) -> Tensor:
        image = self.unclamped(photo)
        return image if self.training else image.clamp(0, 1)

    def unclamped(self, photo: Tensor) -> Tensor:
        rows, columns = photo.shape[-2:]
        around = (0, -columns % MULTIPLE, 0, -rows % MULTIPLE)
        padded = functional.pad(photo, around, mode="replicate") if any(around) else photo
        image = self.network(padded)
        if not isinstance(image, Tensor) or image.shape != padded.shape:
            found = list(image.shape) if isinstance(image, Tensor) else type(image).__name__
            raise InputError(
                f"the network {self.of} gives {found} for photos of {list(padded.shape)}: it is to give "
                "images of the same shape"
            )
        return image[..., :rows, :columns]


def _class_of(of: str) -> type[nn.Module]:
    """The class `module:Class`. Raises InputError where it is not there."""
    place, _, name = of.partition(":")
    main = sys.modules["__main__"]
    module = main if place == _module_name("__main__") else sys.modules.get(place)
    if module is None:
        raise InputError(
            f"the network is of the class {of}, and nothing is imported on the word of a file: import "
            f"{place} before, or set {TRIED}={place}"
        )
    found: object = module
    for part in name.split("."):
        found = getattr(found, part, None)
    if not (isinstance(found, type) and issubclass(found, nn.Module)):
        raise InputError(
            f"the network {of} is no class of torch.nn.Module in a module: define it at the top of one"
        )
    return found


def _module_name(name: str) -> str:
    """A module's name, also for those that import it: that of its file for a script that is running."""
    file = getattr(sys.modules.get(name), "__file__", None)
    return Path(file).stem if name == "__main__" and file else name
