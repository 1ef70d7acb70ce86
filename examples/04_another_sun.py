"""
The map under another Sun
=========================

A map has normals and albedos, so that it can be lit from anywhere: to plan images, to compare with a later image, or
to see relief that one Sun hides.
"""

# %%
# The map of the first example; it is read back if it is there.
from dataclasses import replace
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import photoclinometry as pcm

folder = Path("build")
site = pcm.simulate("demo", folder / "site", views=9, image_size=288, region_size=64, overwrite=True)
scene = pcm.run(site, folder / "run").scene

# %%
# First under a Sun that it was mapped with: the rendering of a view should equal its image. ``brightness`` is I/F here,
# ``valid`` is where the map is.
name = scene.views.name[0]
drawn = pcm.render(scene, view=name)
print(name, drawn.brightness.shape, f"{drawn.valid.mean():.1%} of the image is mapped")

# %%
# Then from four sides, 40 degrees above the horizon. Azimuths count clockwise from up in the reference image. Cast
# shadows are those of the map's own ground. Above: as it would look. Below: with the same albedo everywhere, which
# shows the relief alone.
even = np.full(len(scene.landmarks), np.median(scene.landmarks.albedo))
relief = replace(scene, landmarks=replace(scene.landmarks, albedo=even))
fig, axes = plt.subplots(2, 4, figsize=(11, 6), layout="constrained")
for row, ground in zip(axes, (scene, relief), strict=True):
    for ax, azimuth in zip(row, (0, 90, 180, 270), strict=True):
        lit = pcm.render(ground, sun_azimuth_deg=azimuth, sun_elevation_deg=40, geometry="reference", cast_shadows=True)
        ax.imshow(np.where(lit.valid, lit.brightness, np.nan), cmap="gray", vmin=0, vmax=0.3)
        ax.set(title=f"Sun from {azimuth}°", xticks=[], yticks=[])
