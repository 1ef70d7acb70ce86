"""From what archives hold to a site: images, cameras, Sun directions, pose priors.

io/archive.py -> facts (labels) -> detector (intrinsics) -> geometry (Sun, pose) -> upright images -> site.toml
"""
