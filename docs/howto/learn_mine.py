"""A mask, a network and a loss of one's own against two other systems: python learn_mine.py STEPS SEEDS"""

import statistics
import sys

import matplotlib.pyplot as plt
import skimage.data
import torch
from torch import nn
from torch.utils.data import Dataset

import edofsim
from edofsim.learn import evaluate, fit


class Pictures(Dataset):
    names = ("astronaut", "chelsea", "coffee", "rocket")

    def __len__(self):
        return len(self.names)

    def __getitem__(self, index):
        return torch.from_numpy(getattr(skimage.data, self.names[index])()).permute(2, 0, 1)


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


def loss(restored, ideal):
    return (restored - ideal).abs().mean() + (restored.diff() - ideal.diff()).abs().mean()


def main(steps, seeds):
    lens = edofsim.camera(window=64)
    systems = {
        "lens alone": lambda: (lens, None),
        "cubic mask": lambda: (edofsim.camera("paper-cubic", window=64), None),
        "mask that learns": lambda: (lens, Cubic()),
    }
    levels = {name: [] for name in systems}
    for name, system in systems.items():
        for seed in range(seeds):
            torch.manual_seed(seed)
            camera, mask = system()
            how = {"mask": mask, "loss": loss, "steps": steps, "patch_px": 64, "mask_learning_rate": 0.02}
            done = fit(camera, UNet(), Pictures(), seed=seed, out=f"out/{name}/{seed}", **how)
            levels[name].append(evaluate(done.checkpoint, camera, count=8, patch_px=128).psnr_db)
    means, spread = (
        [kind(found) for found in levels.values()] for kind in (statistics.mean, statistics.stdev)
    )
    for name, mean, deviation in zip(levels, means, spread, strict=True):
        print(f"{name:17} {mean:.2f} dB +- {deviation:.2f}")
    figure, axes = plt.subplots(figsize=(5, 1.8), layout="constrained")
    axes.errorbar(means, list(levels), xerr=spread, fmt="o", capsize=4)
    axes.set(xlabel=f"PSNR [dB], {seeds} seeds of {steps} steps", ylim=(2.5, -0.5))
    figure.savefig("systems.svg")


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]))
