"""
Your own camera
===============

A camera by numbers: focal length, f-number, focus, pixel pitch.
"""

import math

import numpy as np
from matplotlib import pyplot

import edofsim

# %%
# Lengths are in metres. The paper's values stand for all others: here the sensor's response and read noise.

camera = edofsim.camera(focal_length=0.025, f_number=2.8, focus=1.0, pixel=4.5e-6, window=64)
camera

# %%
# The PSFs at 550 nm from near to far, and the square root of their second moment: how far the blur spreads.

depths = [0.7, 0.8, 0.9, 1.0, 1.2, 1.5, 2.0]
bank = edofsim.psfs(camera, depths, [550e-9])
offset = np.arange(64) - 32
widths = []
for psf in bank.values[:, 0].numpy():
    moment = (psf * (offset[:, None] ** 2 + offset**2)).sum() / psf.sum()
    widths.append(math.sqrt(moment))

figure, axes = pyplot.subplots(figsize=(6, 3), layout="constrained")
axes.plot(depths, widths, "o-", label="by wave optics")
radius = camera.aperture_radius * camera.sensor_distance / camera.pixel
rays = [radius * abs(1 / z - 1 / 1.0) / math.sqrt(2) for z in depths]
axes.plot(depths, rays, "--", label="a uniform disc, by rays")
axes.set_xlabel("depth / m")
axes.set_ylabel("blur / pixels, rms")
axes.legend()

# %%
# A recipe holds a camera for all commands. ``edofsim new camera mine`` writes one with a remark to each key,
# and ``edofsim psf mine.toml`` shows its PSFs. This is a shipped camera with one number changed:

noisy = edofsim.camera("paper-learned", read_noise=0.02)
noisy
