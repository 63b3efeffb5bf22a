"""
Restore a photo
===============

A network that was trained for the mask, one for any camera, and Wiener deconvolution.
"""

import math

from matplotlib import pyplot
from skimage.data import stereo_motorcycle

import edofsim

# %%
# Begin with a photo through the learned mask.

left, _, disparity = stereo_motorcycle()
depth = 0.3 * 0.193001 * 994.978 / (disparity[200:328, 320:480] + 31.086)
view = edofsim.View.from_image(left[200:328, 320:480], depth)
camera = edofsim.camera("paper-learned")
photo = edofsim.photograph(view, camera)
photo

# %%
# PSNR against the all-in-focus image, both clipped to full scale:


def psnr(image) -> float:
    error = (image.clamp(0, 1) - photo.ideal.clamp(0, 1)).square().mean()
    return -10 * math.log10(float(error))


# %%
# ``paper-bank`` restores by default. Like ``depth-dcnn``, it estimates the distance of each place.
# ``paper-dcnn`` is the paper's own network, which learned together with this mask. Wiener deconvolution uses
# only the PSFs.

far = (0.6, 1.5)
images = {
    "photo": photo.image,
    "paper-dcnn": edofsim.restored(photo, camera, network="paper-dcnn"),
    "paper-bank": edofsim.restored(photo, camera),
    "Wiener": edofsim.restored(photo, camera, network="wiener", depths=far),
}
figure, axes = pyplot.subplots(2, 2, figsize=(8, 6.8), layout="constrained")
for ax, (name, image) in zip(axes.flat, images.items(), strict=True):
    edofsim.show(image, f"{name}: {psnr(image):.2f} dB", ax, photo.colours)

# %%
# ``universal`` is for cameras that no network was trained for. It is conditioned on their PSFs.
# ``edofsim train`` trains a network for your own camera.

own = edofsim.camera("paper-cubic")
of_own = edofsim.photograph(view, own, accuracy="40dB")
sharp = edofsim.restored(of_own, own, depths=far)
axes = edofsim.show(sharp, "the cubic mask, universal", colours=of_own.colours)
