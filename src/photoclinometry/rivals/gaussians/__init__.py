"""Three-dimensional Gaussians: their projection, their blending, and their training, on the CPU."""

import photoclinometry.model.kernel_cache  # noqa: F401 - before anything below is compiled
