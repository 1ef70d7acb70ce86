"""
A live map
==========

People judge a map by moving the Sun. The viewer's page does that in a notebook, and here: it is the page that every run
leaves as ``report/viewer.html``, and needs neither a server nor a network.
"""

# %%
# The map of the first example; it is read back if it is there.
from dataclasses import replace
from pathlib import Path

import numpy as np

import photoclinometry as pcm
from photoclinometry.matching.densify import DensifyOptions

folder = Path("build")
site = pcm.simulate("demo", folder / "site", views=9, image_size=288, region_size=64, overwrite=True)
result = pcm.run(site, folder / "run", densify=DensifyOptions(min_views=5))

# %%
# Drag the yellow Sun on the disc, or play a day. Drag the map to turn it. "Swipe" puts the first image beside its
# rendering. "Profile" and two clicks on the map draw the heights between them, with their uncertainty; under the
# cursor every value has its standard deviation. ``?`` lists all keys.
pcm.view(result)

# %%
# A scene by itself, read from ``scene.h5`` or changed in Python, has a page, too, without the images: here with the
# same albedo everywhere, so that the rendering shows the relief alone.
scene = result.scene
even = np.full(len(scene.landmarks), np.median(scene.landmarks.albedo))
pcm.view(replace(scene, landmarks=replace(scene.landmarks, albedo=even)), height_px=480)
