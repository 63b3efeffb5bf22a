"""A network and a mask of one's own learn together: python first_training.py STEPS"""

import sys

import torch
from torch import nn

import edofsim
from edofsim.learn import fit


class UNet(nn.Module):
    def __init__(self, width=16):
        super().__init__()
        self.width = width
        self.fine, self.coarse = (
            nn.Sequential(nn.Conv2d(a, width, 3, padding=1), nn.ReLU(), nn.Conv2d(width, width, 3, padding=1))
            for a in (3, width)
        )
        self.last = nn.Conv2d(2 * width, 3, 3, padding=1)

    def forward(self, photo):
        fine = self.fine(photo).relu()
        coarse = self.coarse(nn.functional.avg_pool2d(fine, 4))
        return photo + self.last(torch.cat([fine, nn.functional.interpolate(coarse, scale_factor=4)], 1))


class Cubic(nn.Module):
    def __init__(self, micrometres=1.0):
        super().__init__()
        self.strength = nn.Parameter(torch.tensor(micrometres))

    def forward(self):  # metres, row 0 the top of the pupil
        across = torch.linspace(-1, 1, 200)
        return self.strength * 1e-6 * (across**3 + across.flip(0)[:, None] ** 3)


if __name__ == "__main__":
    how = {"steps": int(sys.argv[1]), "patch_px": 64, "mask_learning_rate": 0.02, "learning_rate": 3e-3}
    print(fit(edofsim.camera(window=64), UNet(), mask=Cubic(), **how).figures)
