"""A network for any camera: it adds again what the mean blur takes away, less where noise is more."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

from edofsim.plugins import Restorer

USUAL_NOISE = 0.01


class UnsharpMask(Restorer):
    """Adds `strength` times the difference between the photo and the photo blurred by the mean PSF."""

    kind = "unsharp-mask"
    psfs = "mean"
    any_camera = True

    def __init__(self, width: int = 9, strength: float = 0.5) -> None:
        super().__init__()
        self.width, self.around = width, width // 2
        self.radius, self.border = self.around, self.around
        self.strength = nn.Parameter(torch.tensor(strength))
        self.register_buffer("psf", torch.zeros(3, 1, width, width))
        self.register_buffer("trust", torch.tensor(1.0))

    def settings(self) -> dict[str, object]:
        return {"width": self.width}

    def psf_depths(self, depth_range: tuple[float, float]) -> Tensor:
        return torch.linspace(*depth_range, 5, dtype=torch.float64)

    def set_camera(self, psf: Tensor, noise: float) -> None:
        start = psf.shape[-1] // 2 - self.width // 2
        middle = psf.mean(0)[:, None, start : start + self.width, start : start + self.width]
        self.psf.copy_(middle / middle.sum((-1, -2), keepdim=True))
        self.trust.fill_(1 / (1 + (noise / USUAL_NOISE) ** 2))

    def forward(self, photo: Tensor) -> Tensor:
        around = functional.pad(photo, (self.around,) * 4, mode="replicate")
        lost = photo - functional.conv2d(around, self.psf, groups=3)
        sharp = photo + self.trust * self.strength * lost
        return sharp if self.training else sharp.clamp(0, 1)
