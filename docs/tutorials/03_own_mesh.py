"""
Your own mesh
=============

A scene is a TOML file of objects. An object can be a mesh from another program.
"""

import tempfile
from pathlib import Path

import trimesh
from matplotlib import pyplot

import edofsim

# %%
# OBJ, PLY, STL and GLB files are read. Here trimesh makes a ring.

folder = Path(tempfile.mkdtemp())
ring = trimesh.creation.torus(major_radius=1.0, minor_radius=0.35)
ring.export(folder / "ring.glb")

# %%
# ``edofsim new scene NAME`` writes a commented recipe to start from. The shortest recipe with a mesh is:

(folder / "ring.toml").write_text("""
name = "ring"
camera = "paper-clear"

[frame]
width_px = 128
height_px = 96

[render]
samples = 32

[[lights]]
kind = "sky"
radiance = 1.0

[[objects]]
kind = "wall"
depth_m = 3.0
[objects.surface]
kind = "matt"
texture = { kind = "wood", light = "#d3a06a", dark = "#94602f" }

[[objects]]
kind = "mesh"
path = "ring.glb"
size_mm = 8
depth_m = 0.7
turn_deg = 40
surface = { kind = "plastic", reflectance = "#2471a3", roughness = 0.1 }
""")

# %%
# The path is relative to the recipe; ``size_mm`` is the longest side, whatever units the file is in. A frame
# of 128 pixels is 15 mm wide at 0.7 m: the paper's camera looks through a long lens.

view = edofsim.view(folder / "ring.toml", cache=folder)
view

# %%
# Rendered views hold what is behind an edge: the wall continues behind the ring, and a blur uncovers it.

photo = edofsim.photograph(view, edofsim.camera("paper-clear"))
figure, axes = pyplot.subplots(1, 2, figsize=(8, 3.1), layout="constrained")
edofsim.show(view.picture(), "all in focus", axes[0])
axes = edofsim.show(photo.image, "photographed", axes[1], photo.colours)
