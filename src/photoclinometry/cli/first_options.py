"""The options that `phomo COMMAND --help` shows of commands with many; `--help-all` shows all.

Arguments of the command itself, such as `--out`, are always shown.
"""

FIRST = {
    "run": (
        "reflectance",
        "hold_out",
        "region.size_px",
        "region.stride",
        "densify.min_views",
        "adjust.uncertainty",
    ),
    "body": (
        "plan.tile_px",
        "plan.max_views",
        "plan.min_views",
        "run.reflectance",
    ),
    "refine": (
        "reflectance",
        "body",
        "albedo_unit",
        "brightness",
        "reference",
        "shadow_threshold",
        "min_observations",
        "adjust.uncertainty",
    ),
    "simulate": (
        "out",
        "overwrite",
        "preset",
        "lighting",
        "seed",
        "views",
        "image_size",
        "region_size",
        "surface",
        "shape",
        "gsd",
        "reflectance",
        "brightness",
    ),
    "study": (
        "presets",
        "models",
        "surfaces",
        "lightings",
        "seeds",
        "views",
        "image_size",
        "region_size",
    ),
    "rivals": (
        "spc.poses",
        "splat.iterations",
        "splat.degree",
    ),
    "export": (
        "products",
        "transform",
        "site",
        "unit_m",
        "body",
        "radii_m",
        "resolution",
        "density_kg_m3",
        "spin_period_h",
    ),
    "ingest": (
        "kernels",
        "sumfiles",
        "suns",
        "camera",
        "pinhole",
        "body",
        "uncalibrated",
        "keep_going",
    ),
}
"""By command: names of fields, with the group that they are in."""
