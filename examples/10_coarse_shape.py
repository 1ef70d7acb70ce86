"""
A coarse shape places a map
===========================

Poses of spacecraft navigation put a map on the body to hundreds of metres. Where there is no laser altimeter, a coarse
shape or terrain model does it better. It is given as one track of an altimeter, of so few points that their errors are
independent.
"""

# %%
# A simulated site, whose pose priors are off by 0.03 degrees and 640 m each, and by 600 m alike.
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from scipy.ndimage import gaussian_filter

import photoclinometry as pcm
from photoclinometry.io.altimetry_csv import write_altimetry
from photoclinometry.model.altimetry import track_of_surface
from photoclinometry.simulate.truth_file import read_truth

folder = Path("build")
site = pcm.simulate(
    "demo", folder / "placed", views=9, image_size=288, region_size=64,
    pose_sigma=(0.03, 640.0), pose_common_sigma=(0.02, 600.0), overwrite=True,
)  # fmt: skip

# %%
# The coarse shape: the true ground, smoothed over 200 m. Of a real one, read the vertices of its mesh by
# ``photoclinometry.io.ground.read_ground`` or the cells of a GeoTIFF by
# ``photoclinometry.io.rasters.geotiff.read_dtm_mesh``, in metres of the body-fixed frame.
ground = read_truth(site.with_name("truth.h5")).surface
line = np.arange(-4000.0, 4000.0, 50.0)
xy = np.stack(np.meshgrid(line, line), -1)
true = ground.height_at(xy)
coarse = gaussian_filter(true, 200.0 / 50.0, mode="nearest")
points = np.column_stack([xy.reshape(-1, 2), coarse.ravel()])

# %%
# What it smooths away is its error, and is alike over as much ground as a Gaussian of 200 m averages over: a square of
# 710 m. All points within a square count as one.
sigma, side = float(np.std(coarse - true)), np.sqrt(4.0 * np.pi) * 200.0

# %%
# One track, with a shift of 10 m as a whole.
shape = track_of_surface(points, spacing=side, sigma=sigma, shift_sigma=10.0)
write_altimetry(folder / "shape.csv", shape)
print(f"{len(shape)} of {len(points)} points, each good to {sigma:.0f} m")

# %%
# How far the map then is from its true place, how well the run says to know that, and how far the shape has moved it
# from where the pose priors alone would put it.
result = pcm.run(site, folder / "by-shape", altimetry=folder / "shape.csv")
off = pcm.evaluate(result, truth=site.with_name("truth.h5")).metrics["frame_offset_m"]
print(f"{off:.0f} m off its place, +- {result.metrics['frame_offset_sigma_m']:.0f} m")
print(f"moved by {result.metrics['altimetry_moved_m']:.0f} m")

# %%
# The points that lie on the map, over its heights.
positions = result.scene.landmarks.position
fig, ax = plt.subplots(figsize=(5, 4), layout="constrained")
shown = ax.scatter(*positions[:, :2].T, c=positions[:, 2], s=4)
ax.scatter(*shape.position[:, :2].T, color="tab:red", s=20, label="points of the shape")
ax.set(xlim=np.percentile(positions[:, 0], [0, 100]), ylim=np.percentile(positions[:, 1], [0, 100]), aspect="equal")
ax.set(xlabel="x [m]", ylabel="y [m]")
ax.legend(loc="upper right")
fig.colorbar(shown, ax=ax, label="height [m]")
