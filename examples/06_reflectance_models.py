"""
Reflectance models
==================

Brightness depends on incidence, emission and phase. Which model is used matters most for normals. Here are the models,
and a map made with another one.
"""

# %%
# A model is looked up by name, with the published coefficients of a body where there are any. It is a function of the
# cosines of incidence and emission and of the phase angle [rad]; it returns I/F over normal albedo.
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import photoclinometry as pcm

print(*pcm.reflectance_models())

incidence = np.radians(np.linspace(0, 85, 200))
fig, ax = plt.subplots(figsize=(5.6, 3.6), layout="constrained")
for name in ("lunar-lambert", "minnaert", "akimov+", "hapke"):
    model = pcm.reflectance(name, body="vesta")
    # the camera looks straight down, so that phase is incidence
    ax.plot(np.degrees(incidence), model(np.cos(incidence), np.ones(200), incidence), label=name)
ax.set(xlabel="incidence = phase [°]", ylabel="I/F over normal albedo", title="Vesta, camera overhead")
ax.legend()

# %%
# The site of the first example follows Lunar-Lambert. It is mapped with that, and with McEwen's function, which has
# no coefficients of its own and no phase function: each image then has a free scale.
folder = Path("build")
site = pcm.simulate("demo", folder / "site", views=9, image_size=288, region_size=64, overwrite=True)
matched = pcm.run(site, folder / "run")
other = pcm.run(site, folder / "run-mcewen", reflectance="mcewen")

# %%
# Where scales are free, the disk function alone has to be right, and here it nearly is. On ground that follows neither
# model, normals suffer most: the explanation of matching has measured cases.
for name, result in (("lunar-lambert", matched), ("mcewen", other)):
    m = pcm.evaluate(result, truth=site.with_name("truth.h5"), images=False).metrics
    print(
        f"{name:14} normals {m['normal_error_mean_deg']:.2f}°"
        f"  albedo {m['albedo_error_mean_percent']:.2f} %  surface {m['surface_distance_mean_gsd']:.3f} GSD"
    )

# %%
# Without a phase function, the scales of the images follow it: the ground darkens as the phase grows. With one, they
# stay at 1.
fig, ax = plt.subplots(figsize=(5.6, 3.6), layout="constrained")
for name, result in (("lunar-lambert", matched), ("mcewen", other)):
    views = result.scene.views
    towards = views.body_from_cam.translation - result.scene.landmarks.position.mean(0)
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    phase = np.degrees(np.arccos((towards * views.sun).sum(1)))
    ax.plot(phase, views.scale, "o", label=name)
ax.set(xlabel="phase [°]", ylabel="scale of the image")
ax.legend()
