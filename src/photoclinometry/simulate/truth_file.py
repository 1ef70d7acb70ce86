"""`truth.h5`: the surface, views and photometry of a simulated site.

It is read and written here, not in `io`, since its content is the simulator's types, which `io` must not import.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from photoclinometry.io.atomic import atomic_path
from photoclinometry.io.hdf5 import check_hdf5
from photoclinometry.model.errors import InputError
from photoclinometry.model.geometry import Rigid
from photoclinometry.model.scene import VIEW_ARRAYS, Camera, Views
from photoclinometry.simulate.photometry import as_dict, from_dict
from photoclinometry.simulate.surface import Surface
from photoclinometry.simulate.truth import Truth

FORMAT = "photoclinometry truth"
VERSION = 1

_VIEW_DATA = {
    "rotation": "body_from_cam rotation matrices, -",
    "translation": "camera centres in B, m",
    "sun": "unit vectors towards the Sun in B, -",
    "sun_measured": "unit vectors towards the Sun as measured, in C, -",
    "sun_sigma": "rad, of each view's own error about each tangent axis of sun_measured",
    "sun_common_sigma": "rad, of the rotation that errors of all sun_measured share",
    "scale": "brightness per I/F",
    "bias": "brightness without light",
}
_GRIDS = {
    "height": "z in B, m; rows go north (y), columns east (x)",
    "albedo": "normal albedo, I/F at zero incidence, emission and phase",
}


def write_truth(path: Path | str, truth: Truth) -> None:
    """The truth as one file, the surface's grids in single precision, compressed. Raises RunFolderError."""
    import h5py

    surface, views = truth.surface, truth.views
    data = {
        "rotation": views.body_from_cam.rotation,
        "translation": views.body_from_cam.translation,
        **{key: getattr(views, key) for key in VIEW_ARRAYS},
    }
    with atomic_path(path) as temporary, h5py.File(temporary, "w") as file:
        file.attrs["format"], file.attrs["version"] = FORMAT, VERSION
        file.attrs["name"], file.attrs["body"] = truth.name, truth.body
        file.attrs["brightness"], file.attrs["psf_sigma_px"] = truth.brightness, truth.psf_sigma_px
        file.attrs["photometry"] = json.dumps(as_dict(truth.photometry))
        group = file.create_group("surface")
        group.attrs["spacing_m"], group.attrs["origin_m"] = surface.spacing, surface.origin
        for key, meaning in _GRIDS.items():
            values = getattr(surface, key).astype(np.float32)
            dataset = group.create_dataset(
                key, data=values, chunks=True, compression="gzip", compression_opts=1, shuffle=True
            )
            dataset.attrs["unit"] = meaning
        group = file.create_group("views")
        group.attrs["cameras"] = json.dumps([(c.model, c.width, c.height, list(c.params)) for c in views.cameras])
        group["name"] = list(views.name)
        for key, meaning in _VIEW_DATA.items():
            group.create_dataset(key, data=data[key]).attrs["unit"] = meaning


def read_truth(path: Path | str) -> Truth:
    """The truth in the file. Raises InputError if it is missing, damaged, no truth or of another version."""
    import h5py

    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: there is no such truth file; `phomo simulate` writes one beside site.toml")
    check_hdf5(path, "truth file", "simulate it again")
    try:
        with h5py.File(path, "r") as file:
            if file.attrs.get("format") != FORMAT:
                raise InputError(f"{path}: is an HDF5 file, but not the truth of a simulated site; check the path")
            if file.attrs["version"] != VERSION:
                raise InputError(
                    f"{path}: has version {file.attrs['version']} of the format, this program reads "
                    f"{VERSION}; simulate the site again"
                )
            truth = _truth(file)
    except InputError as error:
        raise InputError(f"{path}: {str(error).removeprefix(f'{path}: ')}; simulate it again") from error
    # A damaged file makes h5py raise nearly every built-in exception.
    except Exception as error:
        raise InputError(f"{path}: cannot be read as a truth file ({error}); simulate it again") from error
    _check(path, truth)
    return truth


def _check(path: Path, truth: Truth) -> None:
    """Raises InputError where the arrays of the views do not agree."""
    views = truth.views
    shapes = {"rotation": (3, 3), "translation": (3,), "sun": (3,), "sun_measured": (3,)}
    parts = {"rotation": views.body_from_cam.rotation, "translation": views.body_from_cam.translation}
    for key in _VIEW_DATA:
        values = parts[key] if key in parts else getattr(views, key)
        expected = (len(views.name), *shapes.get(key, ()))
        if np.shape(values) != expected or not np.isfinite(np.asarray(values)).all():
            raise InputError(f"{path}: {key} is not of {expected} finite numbers; simulate it again")
    if len(views.cameras) != len(views.name):
        raise InputError(f"{path}: has {len(views.cameras)} cameras of {len(views.name)} views; simulate it again")


def _truth(file: Any) -> Truth:
    group = file["views"]
    cameras = tuple(
        Camera(model, width, height, tuple(params))
        for model, width, height, params in json.loads(group.attrs["cameras"])
    )
    data = {key: group[key][()] for key in _VIEW_DATA if key in group or key != "sun_common_sigma"}
    # Files from before errors of Suns could be common.
    data.setdefault("sun_common_sigma", np.zeros(len(data["sun"])))
    views = Views(
        name=tuple(group["name"].asstr()[()]),
        cameras=cameras,
        body_from_cam=Rigid(data.pop("rotation"), data.pop("translation")),
        **data,
    )
    group = file["surface"]
    surface = Surface(
        group["height"][()],
        group["albedo"][()],
        float(group.attrs["spacing_m"]),
        (float(group.attrs["origin_m"][0]), float(group.attrs["origin_m"][1])),
    )
    return Truth(
        name=str(file.attrs["name"]),
        body=str(file.attrs["body"]),
        surface=surface,
        views=views,
        psf_sigma_px=float(file.attrs["psf_sigma_px"]),
        brightness=str(file.attrs["brightness"]),
        photometry=from_dict(json.loads(file.attrs["photometry"])),
    )
