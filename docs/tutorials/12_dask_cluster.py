"""
A job on a Dask cluster
=======================

Many views at once, on one machine or on a cluster.
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

from distributed import LocalCluster
from matplotlib import pyplot

# %%
# A family is a recipe with values drawn from ranges. Each member is another scene.

folder = Path(tempfile.mkdtemp())
(folder / "balls.toml").write_text("""
name = "balls"

[frame]
width_px = 48
height_px = 36
margin_px = 16

[bands]
count = 5

[render]
samples = 16

[[lights]]
kind = "sky"

[[objects]]
kind = "wall"
depth_m = 3.0

[[objects]]
kind = "sphere"
name = "ball"
depth_m = 0.8
radius_mm = 2
surface = { kind = "plastic", reflectance = "#c0392b", roughness = 0.1 }

[family]
vary = [
  { key = "objects.ball.depth_m", inverse_uniform = [0.6, 1.2] },
  { key = "objects.ball.x_frame", uniform = [-0.8, 0.8] },
]
""")

# %%
# Here the cluster has two workers on this machine; Dask starts the same on SLURM, Kubernetes or in a cloud
# (``dask-jobqueue``, ``dask-kubernetes``). Its workers must see the folder of the cache.

if __name__ == "__main__":
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        command = ["render", "balls.toml", "--members", "3", "--cache", str(folder)]
        where = ["--cluster", cluster.scheduler_address, "--quiet"]
        run = [sys.executable, "-m", "edofsim", *command, *where]
        subprocess.run(run, check=True, cwd=folder, stdout=subprocess.DEVNULL)

# %%
# Finished views are in the cache. The same command renders only what is missing, also after an interrupt. If
# a worker dies, complete views are kept.

if __name__ == "__main__":  # a worker reads this file too
    print(len(list(folder.glob("*.exr"))), "views")

# %%
# The manifest says of each view where it was rendered, with how many samples and how much noise, and how long
# it took.

if __name__ == "__main__":
    lines = (folder / "manifest.jsonl").read_text().splitlines()
    rendered = sorted(map(json.loads, lines), key=lambda each: each["name"])
    names, noise = zip(*((each["name"], 100 * each["noise"]) for each in rendered), strict=True)
    print(*rendered[0])
    figure, axes = pyplot.subplots(figsize=(5, 2), layout="constrained")
    axes.barh(names, noise)
    axes.set_xlabel("noise of a pixel / %")
