"""
A first photo
=============

A view is what is in front of the lens; a camera makes a photo of it; a network sharpens the photo.
"""

import edofsim

# %%
# ``motorcycle`` is the quickest of the scenes that ship: a photograph with measured depths, so that nothing
# has to be rendered. ``edofsim list scenes`` names the others.

view = edofsim.view("motorcycle")
view

# %%
# The paper's camera: a lens of 36 mm with a mask in its pupil, which was learned together with a network.

camera = edofsim.camera("paper-learned")
camera

# %%
# The photo. A plan decides what is simulated: it asks for less error than half of the sensor's noise. The
# mask blurs things at all depths alike: that is what it is for.

photo = edofsim.photograph(view, camera)
photo

# %%
# The network undoes that blur. Photos have the sensor's own colours, which are not those that the eye sees.

sharp = edofsim.restored(photo, camera)
axes = edofsim.show(sharp, "restored", colours=photo.colours)

# %%
# ``photo.save("photo.exr")`` keeps the photo as linear light with all that belongs to it, for
# ``edofsim.Photo.load``; ``photo.save("photo.png")`` keeps a picture, and
# ``edofsim.save_image("sharp.png", sharp, photo.colours)`` does so for any image. On the command line all
# of this page is one command, whose report also scores what came out:
#
# .. code-block:: console
#
#    $ edofsim run motorcycle
