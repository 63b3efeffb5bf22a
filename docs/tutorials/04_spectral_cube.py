"""
A cube of 31 bands
==================

A spectral image is photographed band by band, each through its own blur.
"""

import tempfile
from pathlib import Path

import numpy as np
from matplotlib import pyplot
from skimage.data import astronaut
from skimage.io import imsave

import edofsim

# %%
# Cubes come as a folder with one picture a band, as a MAT file, or as OpenEXR. For an example, each band is a
# mixture of a photograph's red, green and blue that changes with the wavelength.

folder = Path(tempfile.mkdtemp())
(folder / "cube").mkdir()
rgb = astronaut()[64:256, 160:352] / 255.0
for band, nm in enumerate(np.linspace(420, 720, 31)):
    weights = np.exp(-(((nm - np.array([610, 540, 460])) / 50) ** 2))
    image = (rgb**2.2) @ (weights / weights.sum())
    file = folder / "cube" / f"band_{band:02d}.png"
    imsave(file, (65535 * image).astype(np.uint16), check_contrast=False)

# %%
# A recipe says which wavelengths these are, and how far away the plane is. CAVE's cubes are read the same
# way.

(folder / "cube.toml").write_text("""
name = "cube"

[frame]
width_px = 128
height_px = 128
margin_px = 32

[source]
kind = "cube"
path = "cube"
start_nm = 420
step_nm = 10
depth_m = 0.8
""")
view = edofsim.view(folder / "cube.toml")
view

# %%
# The camera's PSF at 0.8 m depends on the wavelength: the lens disperses light, and so does the mask.

camera = edofsim.camera("paper-cubic", window=64)
bands = [450e-9, 550e-9, 650e-9]
bank = edofsim.psfs(camera, [0.8], bands)
figure, axes = pyplot.subplots(1, 3, figsize=(7, 2.6), layout="constrained")
for ax, psf, nm in zip(axes, bank.values[0], bands, strict=True):
    ax.imshow(psf.sqrt(), cmap="magma")
    ax.set_title(f"{nm * 1e9:.0f} nm")
    ax.set_axis_off()

# %%
# There is one depth and no edge, so the plan leaves occlusion and depth layers out.

plan = edofsim.plan_for(view, camera)
plan

# %%
photo = edofsim.photograph(view, camera, plan)
axes = photo.show()
