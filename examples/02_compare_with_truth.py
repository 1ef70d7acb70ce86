"""
How good is a map?
==================

The images of this site are simulated, so that the true surface is known. The map is aligned with it by seven numbers
(origin, orientation, scale), which images alone leave open, and every landmark is compared.
"""

# %%
# The map of the first example; it is read back if it is there.
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import photoclinometry as pcm

folder = Path("build")
site = pcm.simulate("demo", folder / "site", views=9, image_size=288, region_size=64, overwrite=True)
result = pcm.run(site, folder / "run")

# %%
# ``evaluate`` returns every figure by name; the unit ends the name. GSD is the ground sample distance: one pixel of the
# reference image on the ground.
found = pcm.evaluate(result, truth=site.with_name("truth.h5"))
for name in ("surface_distance_mean_gsd", "normal_error_mean_deg", "albedo_error_mean_percent", "psnr_mean_db"):
    print(f"{name:28} {found.metrics[name]:8.3f}")

# %%
# The comparison keeps the error of each landmark. Errors are largest on small craters and at the edges of shadows.
fig, axes = plt.subplots(1, 3, figsize=(10, 3.4), layout="constrained")
for ax, name in zip(axes, ("surface_distance_m", "normal_error_deg", "albedo_error_percent"), strict=True):
    error = result.scene.grid(np.abs(found.comparison.errors[name]))
    shown = ax.imshow(error, cmap="viridis", vmin=0, vmax=np.nanpercentile(error, 98))
    fig.colorbar(shown, ax=ax, shrink=0.8)
    ax.set(title=name, xticks=[], yticks=[])

# %%
# The map states its own uncertainty. The standard deviation of heights agrees in size with the distances found, and the
# errors have longer tails: stated uncertainties are those of noise.
for name in ("height_sigma_median_gsd", "surface_distance_median_gsd", "surface_distance_p90_gsd"):
    print(f"{name:28} {found.metrics[name]:8.3f}")
