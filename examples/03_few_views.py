"""
Few views
=========

What does a map lose when it is made of fewer images? The same site is mapped with nine and with five of its views.
"""

# %%
from dataclasses import replace
from pathlib import Path

import matplotlib.pyplot as plt

import photoclinometry as pcm
from photoclinometry.io.site import write_site

folder = Path("build")
path = pcm.simulate("demo", folder / "site", views=9, image_size=288, region_size=64, overwrite=True)
site = pcm.read_site(path)

# %%
# A site with some of the views is another ``site.toml`` beside the same images. A landmark must be seen in half of the
# views: in five of nine, in three of five (``min_views``).
fewer = path.with_name("site-5.toml")
write_site(fewer, replace(site, views=site.views[:5], path=fewer))
results = {9: pcm.run(path, folder / "run"), 5: pcm.run(fewer, folder / "run-5")}

# %%
# Each is compared with the truth.
print("views  landmarks  surface [GSD]  normals [deg]  albedo [%]")
for views, result in results.items():
    m = pcm.evaluate(result, truth=path.with_name("truth.h5"), images=False).metrics
    print(
        f"{views:5} {len(result.scene.landmarks):10} {m['surface_distance_mean_gsd']:14.3f}"
        f" {m['normal_error_mean_deg']:14.2f} {m['albedo_error_mean_percent']:11.2f}"
    )

# %%
# Surfaces hardly differ: matches give the positions. Normals do: five Suns say less about slopes than nine. Below, the
# normals' component across the reference image. (The run of five views has chosen its own reference image.)
fig, axes = plt.subplots(1, 2, figsize=(7.2, 3.6), layout="constrained")
for ax, (views, result) in zip(axes, results.items(), strict=True):
    reference = result.scene.views.body_from_cam.rotation[result.scene.reference]
    ax.imshow(result.scene.grid((result.scene.landmarks.normal @ reference)[:, 0]), cmap="gray")
    ax.set(title=f"{views} views", xticks=[], yticks=[])
