"""
Export for GIS, viewers and other programs
==========================================

GeoTIFFs of height, albedo, normals and slope, meshes as glTF and OBJ, a COLMAP model, and tables.
"""

# %%
# The map of the first example; it is read back if it is there.
from pathlib import Path

import matplotlib.pyplot as plt
import rasterio

import photoclinometry as pcm

folder = Path("build")
site = pcm.simulate("demo", folder / "site", views=9, image_size=288, region_size=64, overwrite=True)
scene = pcm.run(site, folder / "run").scene

# %%
# A map made from images alone does not know its scale. Here it is known from elsewhere: one unit of the map is 61 m,
# the ground sample distance of this site. GeoTIFFs then have an engineering reference system in metres, not one of
# Vesta: images alone do not say where on Vesta the place is.
files = pcm.export(scene, folder / "maps", products=["dtm", "albedo", "slope", "gltf", "csv"], unit_m=61.0)
for name, about in files.items():
    print(f"{name:20} {about}")

# %%
# The height map, read back by rasterio.
with rasterio.open(folder / "maps" / "dtm.tif") as dtm:
    heights = dtm.read(1)
    print(dtm.width, "x", dtm.height, "pixels of", dtm.res[0], "m;", dtm.crs)

fig, ax = plt.subplots(figsize=(4.6, 3.6), layout="constrained")
shown = ax.imshow(heights, cmap="terrain")
fig.colorbar(shown, ax=ax, label="height [m]")
ax.set(xticks=[], yticks=[])
