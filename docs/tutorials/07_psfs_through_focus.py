"""
PSFs through focus
==================

How the blur of a point changes with its distance, for the cameras that ship.
"""

import math

import torch
from matplotlib import pyplot

import edofsim

# %%
# Three colours in one picture: red, green and blue are the PSFs at 611, 543 and 482 nm, those of the paper.

depths = [0.5, 0.8, 1.0, 1.5, 3.0, math.inf]
colours = [611e-9, 543e-9, 482e-9]
names = ["paper-clear", "paper-cubic", "paper-rings", "paper-learned"]
figure, axes = pyplot.subplots(len(names), len(depths), figsize=(9, 6.4), layout="constrained")
banks = {}
for row, name in zip(axes, names, strict=True):
    camera = edofsim.camera(name, window=64)
    banks[name] = edofsim.psfs(camera, depths, colours).values
    for ax, psf, z in zip(row, banks[name], depths, strict=True):
        ax.imshow((psf / psf.amax()).sqrt().permute(1, 2, 0))
        ax.set(xticks=[], yticks=[], title=f"{z:g} m")
    row[0].set_ylabel(name.removeprefix("paper-"))

# %%
# Without a mask the lens is sharp at another distance for each colour, since glass disperses light. A good
# mask for an extended depth of field has PSFs that are alike: the correlation of each with the one at 1.5
# m, in green.

figure, axes = pyplot.subplots(figsize=(6, 3), layout="constrained")
for name, bank in banks.items():
    green = bank[:, 1].flatten(1)
    like = torch.nn.functional.cosine_similarity(green, green[3][None], dim=1)
    axes.plot([1 / z for z in depths], like, "o-", label=name.removeprefix("paper-"))
axes.set_xlabel("1 / depth / (1/m)")
axes.set_ylabel("correlation with 1.5 m")
axes.legend()
