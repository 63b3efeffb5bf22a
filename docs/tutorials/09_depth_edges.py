"""
Depth edges against rays
========================

A surface in front hides what is behind it from one side of the lens only. How near does a fast composite
come to the truth?
"""

import subprocess
import sys
import tempfile
from pathlib import Path

from matplotlib import pyplot

import edofsim

# %%
# A card in front of a page of text, at one wavelength, and a lens without aberrations, which rays can judge.

folder = Path(tempfile.mkdtemp())
(folder / "card.toml").write_text("""
name = "card"
camera = "clear.toml"

[frame]
width_px = 48
height_px = 48
margin_px = 24

[bands]
start_nm = 543
stop_nm = 543
count = 1

[render]
samples = 64

[[lights]]
kind = "sky"

[[objects]]
kind = "text_page"
depth_m = 2.5
width_mm = 40
height_mm = 40
lines = 8

[[objects]]
kind = "panel"
depth_m = 0.8
x_mm = 5
width_mm = 10
height_mm = 20
surface = { kind = "matt", reflectance = "#c0392b" }
""")
(folder / "clear.toml").write_text("""
name = "clear"

[lens]
kind = "ideal"
focal_length_mm = 36
f_number = 7.2

[psf]
window_px = 48

[sensor]
read_noise = 0.0
""")
view = edofsim.view(folder / "card.toml", cache=folder)

# %%
# ``edofsim expose --reference`` adds a slow and true photo of a crop to the fast one. ``thinlens`` traces
# rays from the whole lens to the scene; ``pupil`` clips the pupil of each point and diffracts at what is in
# the way, with any mask.

command = ["expose", "card.toml", "--reference", "thinlens", "--crop", "12,12,24,24"]
places = ["--out", str(folder), "--cache", str(folder), "--quiet"]
run = [sys.executable, "-m", "edofsim", *command, *places]
subprocess.run(run, check=True, cwd=folder, stdout=subprocess.DEVNULL)
truth = edofsim.read_image(folder / "reference.exr")

# %%
# Compare three ways: add all light (``none``), use visible surfaces, as for a picture with a depth map
# (``normalised``), and use hidden surfaces (``hidden``).

camera = edofsim.camera(folder / "clear.toml")
photos = {}
for way in ("none", "normalised", "hidden"):
    photo = edofsim.photograph(view, camera, edofsim.Fidelity(occlusion=way))
    colours, crop = photo.colours, photo.image[:, 12:36, 12:36]
    psnr = -10 * float((crop - truth).square().mean().log10())
    photos[f"{way}: {psnr:.1f} dB"] = crop
photos["rays"] = truth

figure, axes = pyplot.subplots(1, 4, figsize=(9, 2.6), layout="constrained")
for ax, (title, photo) in zip(axes, photos.items(), strict=True):
    edofsim.show(photo, title, ax, colours)

# %%
# Along a line across the edge, light from behind the card reaches into its picture. Only ``hidden`` has it.

# sphinx_gallery_thumbnail_number = 2
figure, axes = pyplot.subplots(figsize=(6, 3.2), layout="constrained")
for (title, photo), line in zip(photos.items(), (":", "--", "-", "k."), strict=True):
    axes.plot(photo[0].mean(0), line, label=title)
axes.set(xlabel="column / pixels", ylabel="mean of the column")
axes.legend()
