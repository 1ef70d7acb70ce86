"""
Pictures of a map
=================

Layers of a map on matplotlib's axes, a profile with the band of its uncertainty, the residuals of the images, and a
figure for a paper.
"""

# %%
# The map of the first example; it is read back if it is there.
from pathlib import Path

import matplotlib.pyplot as plt

import photoclinometry as pcm

folder = Path("build")
site = pcm.simulate("demo", folder / "site", views=9, image_size=288, region_size=64, overwrite=True)
scene = pcm.run(site, folder / "run").scene

# %%
# Any layer goes on any axes, with its unit, a scale bar and, where a view is named, the direction of its Sun. Ground
# that the map lacks stays blank.
fig, axes = plt.subplots(2, 2, figsize=(10, 8), layout="constrained")
for ax, layer in zip(axes.flat, ("albedo", "height", "normals", "height-sigma"), strict=True):
    pcm.plot(scene, layer, ax=ax, view=scene.views.name[0])

# %%
# A profile goes from one pixel of the reference image to another, here across the middle of the map.
left, middle = scene.region.col + 4, scene.region.row + scene.region.height / 2
right = scene.region.col + scene.region.width - 4
fig, (heights, slopes) = plt.subplots(2, 1, figsize=(9, 5), layout="constrained")
pcm.plot_profile(scene, (left, middle), (right, middle), ax=heights)
pcm.plot_profile(scene, (left, middle), (right, middle), layer="slope", ax=slopes)

# %%
# Residuals tell a bad view from good ones: a box holds the middle half of a view's, the line ends at 5 and 95 per cent.
pcm.plot_residuals(scene)

# %%
# For a paper: maps side by side and the profile below, two columns wide, with the fonts in the file.
file = pcm.figure(scene, folder / "figure.pdf", layers=("albedo", "height"), profile=(left, middle, right, middle))
print(f"{file}: {file.stat().st_size / 1024:.0f} KiB")
