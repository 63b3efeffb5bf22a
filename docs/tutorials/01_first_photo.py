"""
A first photo
=============

A view is the light in front of the lens. A camera makes a photo of it. A network sharpens the photo.
"""

import edofsim

# %%
# ``motorcycle`` is the quickest shipped scene: a photograph with measured depths, so nothing is rendered.
# ``edofsim list scenes`` names the others.

view = edofsim.view("motorcycle")
view

# %%
# The paper's camera: a lens of 36 mm with a mask in its pupil, which was learned together with a network.

camera = edofsim.camera("paper-learned")
camera

# %%
# Make the photo. A plan decides what is simulated: it allows an error of half of the sensor's noise. The mask
# blurs objects at all depths alike, by design.

photo = edofsim.photograph(view, camera)
photo

# %%
# The network removes that blur. Photos have the sensor's own colours, which differ from those that the eye
# sees.

sharp = edofsim.restored(photo, camera)
axes = edofsim.show(sharp, "restored", colours=photo.colours)

# %%
# ``photo.save("photo.exr")`` saves the photo as linear light with all its data, for ``edofsim.Photo.load``.
# ``photo.save("photo.png")`` saves a picture, and ``edofsim.save_image("sharp.png", sharp, photo.colours)``
# does so for any image. On the command line, all of this page is one command. Its report also has scores:
#
# .. code-block:: console
#
#    $ edofsim run motorcycle
