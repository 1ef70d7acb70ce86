"""From archived images to a site: images, cameras, Sun directions, pose priors.

io/archives -> facts (label) -> optics (detector) -> geometry (Sun, pose) -> upright images -> site.toml
"""
