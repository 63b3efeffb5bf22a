"""
Train a diffractive element in five minutes
===========================================

Photos are differentiable from the height of the mask to the sensor, so that a mask can learn.
"""

import math

import torch
from matplotlib import pyplot

import edofsim

# %%
# One command trains mask and network together. It writes checkpoints, pictures, and fabrication files of the
# mask. ``--resume`` continues an interrupted training:
#
# .. code-block:: console
#
#    $ edofsim new train mine
#    $ edofsim train mine.toml --max-minutes 5 --out out/mine
#    $ edofsim run desk --network out/mine/mine.safetensors
#
# A smaller case shows what happens inside. We want a height map whose PSFs are as alike as possible from 0.7
# m to infinity. The heights are a sum of a few odd powers, and their weights learn.

depths = torch.tensor([0.7, 1.0, 1.5, 3.0, math.inf], dtype=torch.float64)
across = torch.linspace(-1, 1, 63, dtype=torch.float64)
x, y = across[None, :], -across[:, None]
terms = torch.stack([x**power + y**power for power in (3, 5, 7)])
weights = torch.tensor([0.05, 0.0, 0.0], dtype=torch.float64, requires_grad=True)
lens = edofsim.camera(window=48)


def psfs_of(weights: torch.Tensor) -> torch.Tensor:
    """PSFs [depth, y, x] in green, for a mask of these weights in micrometres."""
    height = (weights[:, None, None] * terms).sum(0) * 1e-6
    return edofsim.psfs(lens.with_height(height), depths, [543e-9]).values[:, 0]


def unlike(psf: torch.Tensor) -> torch.Tensor:
    """How much transfer functions differ over depth: 0 for PSFs that are all alike."""
    transfer = torch.fft.rfft2(psf)
    differences = (transfer - transfer.mean(0)).abs().square()
    return differences.sum() / transfer.abs().square().sum()


# %%
# Gradients go through the wave optics as through any function of torch.

before = psfs_of(weights).detach()
optimiser = torch.optim.Adam([weights], lr=0.08)
losses = []
for _ in range(25):
    optimiser.zero_grad()
    loss = unlike(psfs_of(weights))
    loss.backward()
    optimiser.step()
    losses.append(float(loss.detach()))
after = psfs_of(weights).detach()
print(f"from {losses[0]:.3f} to {float(unlike(after)):.3f}")
print("weights in um:", [round(weight, 2) for weight in weights.tolist()])

# %%
figure, axes = pyplot.subplots(2, 5, figsize=(8, 3.6), layout="constrained")
for row, bank, name in ((axes[0], before, "start"), (axes[1], after, "learned")):
    for ax, psf, z in zip(row, bank, depths.tolist(), strict=True):
        ax.imshow((psf / psf.max()).sqrt(), cmap="magma")
        ax.set(xticks=[], yticks=[], title=f"{z:g} m")
    row[0].set_ylabel(name)

# %%
figure, axes = pyplot.subplots(figsize=(5, 2.6), layout="constrained")
axes.plot(losses)
axes.set(xlabel="step", ylabel="unlike")
