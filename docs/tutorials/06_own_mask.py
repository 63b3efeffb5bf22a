"""
Your own mask, from a NumPy array
=================================

A mask is a height map in metres at the pupil.
"""

import math

import numpy as np
from matplotlib import pyplot

import edofsim

# %%
# An axicon: a cone, which bends all light inwards by the same angle. Row 0 of the map is the top of the pupil
# as the sensor sees it. The paper's pupil is 5 mm wide, which 239 samples of 21 µm cover.

pitch, samples = 21e-6, 239
across = (np.arange(samples) - samples // 2) * pitch
rho = np.hypot(across[:, None], across) / 2.5e-3
height = 2.5e-6 * (1 - np.minimum(rho, 1))

axicon = edofsim.camera(height=height, pitch=pitch, window=64)
clear = edofsim.camera(window=64)

# %%
# Near points become smaller, and far ones become rings:

depths = [0.5, 0.7, 1.0, 1.5, 3.0, math.inf]
figure, axes = pyplot.subplots(2, len(depths), figsize=(9, 3.4), layout="constrained")
for row, camera, name in ((axes[0], clear, "lens alone"), (axes[1], axicon, "axicon")):
    bank = edofsim.psfs(camera, depths, [543e-9])
    for ax, psf, z in zip(row, bank.values[:, 0], depths, strict=True):
        ax.imshow((psf / psf.max()).sqrt(), cmap="magma")
        ax.set(xticks=[], yticks=[], title=f"{z:g} m")
    row[0].set_ylabel(name)

# %%
# Light outside of the window is given as ``truncated``. Photos have it as veiling glare:

for name, camera in (("lens alone", clear), ("axicon", axicon)):
    outside = edofsim.psfs(camera, [0.5], [543e-9]).truncated.mean()
    print(f"{name}: {float(outside):.2%} of the light of 0.5 m outside")

# %%
# A mask of one of the known families needs no array: ``edofsim list masks`` names them, and a camera's recipe
# gives their numbers. A height map in a file (``.npy``) is named there as well, as ``kind = "height-map"``.
