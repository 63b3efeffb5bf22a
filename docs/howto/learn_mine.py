"""Loss and data of one's own, and two other systems next to it: python learn_mine.py STEPS SEEDS"""

import statistics
import sys

import matplotlib.pyplot as plt
import skimage.data
import torch
from first_training import Cubic, UNet
from torch.utils.data import Dataset

import edofsim
from edofsim.learn import evaluate, fit


class Pictures(Dataset):
    names = ("astronaut", "chelsea", "coffee", "rocket")

    def __len__(self):
        return len(self.names)

    def __getitem__(self, index):
        return torch.from_numpy(getattr(skimage.data, self.names[index])()).permute(2, 0, 1)


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
