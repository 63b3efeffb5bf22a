"""
A plan, and what accuracy costs
===============================

Which effects does a photo call for, and what would it cost to leave one out?
"""

import numpy as np
from matplotlib import pyplot
from skimage.data import astronaut

import edofsim

# %%
# A small picture that slants from 0.6 to 3 m.

rgb = astronaut()[:256:2, 120:376:2]
depth = np.broadcast_to(1 / np.linspace(1 / 3.0, 1 / 0.6, 128)[:, None], (128, 128))
view = edofsim.View.from_image(rgb, depth)
camera = edofsim.camera("paper-cubic", window=64)

# %%
# The plan names every effect, the photo's error without it, its time, and why. It allows an error of half of
# the sensor's noise.

plan = edofsim.plan_for(view, camera)
plan

# %%
# Ask for more, and the plan simulates more; ask for a time, and it takes the best within it. It predicts
# seconds from how fast your machine is, and from what photos on it took before.

for asked in ("35dB", "45dB", "55dB"):
    chosen = edofsim.plan_for(view, camera, accuracy=asked)
    seconds = sum(chosen.seconds.values())
    print(f"{asked}: {chosen.error_db:.1f} dB predicted, in {seconds:.2g} s")
chosen = edofsim.plan_for(view, camera, time="0.1s")
print(f"in 0.1 s: {chosen.error_db:.1f} dB predicted")

# %%
# Compare the photos of these plans with a nearly full simulation:

plan = edofsim.plan_for(view, camera, accuracy="65dB")
true = edofsim.photograph(view, camera, plan).clean
asked, found, seconds = [30, 35, 40, 45, 50, 55], [], []
for db in asked:
    chosen = edofsim.plan_for(view, camera, accuracy=f"{db}dB")
    clean = edofsim.photograph(view, camera, chosen).clean
    seconds.append(sum(chosen.seconds.values()))
    found.append(-10 * float((clean - true).square().mean().log10()))

figure, (left, right) = pyplot.subplots(1, 2, figsize=(8, 3), layout="constrained")
left.plot(asked, found, "o-")
left.plot(asked, asked, "--", color="grey")
left.set(xlabel="asked for / dB", ylabel="found / dB")
right.plot(seconds, found, "o")
right.set(xlabel="seconds of the photo, predicted", ylabel="found / dB")

# %%
# ``edofsim cost SCENE`` measures all of this for a scene, the seconds too, with every effect left out in
# turn, and writes a page.
