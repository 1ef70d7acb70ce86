"""
A first map
===========

Nine images of a crater on Vesta become a map of a part of its wall: camera poses, 4,000 landmarks, and at each landmark
a normal and an albedo. The images are simulated here, with cast shadows, optics and noise. The truth is not used.
"""

# %%
# A site is a folder of images with a file ``site.toml``, which gives the camera and a Sun direction per image.
from pathlib import Path

import matplotlib.pyplot as plt

import photoclinometry as pcm

folder = Path("build")
site = pcm.simulate("demo", folder / "site", views=9, image_size=288, region_size=64, overwrite=True)
for view in pcm.read_site(site).views[:3]:
    print(view.name, "Sun in the camera frame:", view.sun.round(3))

# %%
# ``run`` makes the map. It writes a run folder with a report, and returns the result. Called again with the same
# folder, it reads back what is there: the other examples begin with the same three lines.
result = pcm.run(site, folder / "run")
scene = result.scene
print(f"{len(scene.landmarks)} landmarks in {len(scene.views)} views; PSNR {result.metrics['psnr_mean_db']:.1f} dB")

# %%
# A scene holds arrays: positions (J, 3), normals (J, 3), albedos (J,), and the pixel of the reference image that each
# landmark belongs to. ``scene.grid`` puts values of landmarks onto the grid of these pixels.
fig, axes = plt.subplots(1, 3, figsize=(10, 3.4), layout="constrained")
pictures = {
    "albedo": scene.grid(scene.landmarks.albedo),
    "normal, x": scene.grid(scene.landmarks.normal[:, 0]),
    "normal, y": scene.grid(scene.landmarks.normal[:, 1]),
}
for ax, (title, picture) in zip(axes, pictures.items(), strict=True):
    shown = ax.imshow(picture, cmap="gray")
    fig.colorbar(shown, ax=ax, shrink=0.8)
    ax.set(title=title, xticks=[], yticks=[])

# %%
# The albedo does not look like the relief. That is the test to make first on any map: slope and albedo separate because
# the Sun moved between the images. ``build/run/report/index.html`` has more pictures.
