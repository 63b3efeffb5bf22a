"""
Your own picture with a depth map
=================================

Any picture with a depth for each pixel can be photographed through any camera.
"""

import numpy as np
from matplotlib import pyplot
from skimage.data import stereo_motorcycle

import edofsim

# %%
# Here the picture is the left one of a stereo pair that comes with scikit-image, and the depth follows from
# its disparity and the calibration of the pair (Scharstein et al., 2014). Yours may come from any sensor or
# network, as an array in metres. ``inf`` is background; NaN, 0 and negative values are holes, which are
# filled with the farther of their neighbours.

left, _, disparity = stereo_motorcycle()
rgb = left[200:392, 300:556]
metres = 0.193001 * 994.978 / (disparity[200:392, 300:556] + 31.086)
depth = 0.3 * metres  # drawn together to where a small lens blurs most

# %%
view = edofsim.View.from_image(rgb, depth)
view

# %%
# The lens alone is sharp only at 1.5 m. The cubic mask gives the same blur at all depths instead.

figure, axes = pyplot.subplots(1, 3, figsize=(9, 2.6), layout="constrained")
edofsim.show(view.picture(), "all in focus", axes[0])
for name, ax in (("paper-clear", axes[1]), ("paper-cubic", axes[2])):
    photo = edofsim.photograph(view, edofsim.camera(name))
    edofsim.show(photo.image, name, ax, photo.colours)

# %%
# One pixel of the picture becomes one pixel of the photo. If the camera's pixels see another angle than the
# paper's, say so:
#
# .. code-block:: python
#
#    view = edofsim.View.from_image(rgb, depth, pixel_angle=camera.pixel_angle)
#
# A picture holds no light from behind its edges, and its colours become smooth spectra. Both are guesses, and
# a plan says what they leave out.

holes = np.isinf(disparity[200:392, 300:556]).mean()
print(f"{holes:.1%} of the depths were holes")
