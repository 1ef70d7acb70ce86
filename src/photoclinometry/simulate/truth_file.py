"""`truth.h5`: the surface, views and photometry of a simulated site.

It is read and written here, not in `io`, since its content is the simulator's types, which `io` must not import.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from photoclinometry.io.hdf5 import check_hdf5, new_hdf5
from photoclinometry.model.camera import Camera
from photoclinometry.model.errors import InputError
from photoclinometry.model.geometry import Rigid
from photoclinometry.model.scene import VIEW_ARRAYS, Views
from photoclinometry.simulate.photometry import as_dict, from_dict
from photoclinometry.simulate.surface import Surface
from photoclinometry.simulate.truth import SiteFacts, Truth

FORMAT = "photoclinometry truth"
VERSION = 1
BODY_FORMAT = "photoclinometry body truth"
FORMATS = {FORMAT: "the truth of a place", BODY_FORMAT: "the truth of a whole body"}
"""Content of files of these formats."""

T = TypeVar("T", bound=SiteFacts)

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
    surface = truth.surface
    with new_hdf5(path) as file:
        write_facts(file, truth, FORMAT, VERSION)
        group = file.create_group("surface")
        group.attrs["spacing_m"], group.attrs["origin_m"] = surface.spacing, surface.origin
        for key, meaning in _GRIDS.items():
            write_array(group, key, getattr(surface, key).astype(np.float32), meaning)


def write_array(group: Any, key: str, values: np.ndarray, meaning: str) -> None:
    """A compressed array of a group, with its description."""
    dataset = group.create_dataset(key, data=values, chunks=True, compression="gzip", compression_opts=1, shuffle=True)
    dataset.attrs["unit"] = meaning


def write_facts(file: Any, truth: SiteFacts, form: str, version: int) -> None:
    """All of a truth but its surface, into an open HDF5 file of a named format."""
    views = truth.views
    data = {
        "rotation": views.body_from_cam.rotation,
        "translation": views.body_from_cam.translation,
        **{key: getattr(views, key) for key in VIEW_ARRAYS},
    }
    file.attrs["format"], file.attrs["version"] = form, version
    file.attrs["name"], file.attrs["body"] = truth.name, truth.body
    file.attrs["brightness"], file.attrs["psf_sigma_px"] = truth.brightness, truth.psf_sigma_px
    file.attrs["photometry"] = json.dumps(as_dict(truth.photometry))
    group = file.create_group("views")
    group.attrs["cameras"] = json.dumps([(c.model, c.width, c.height, list(c.params)) for c in views.cameras])
    group["name"] = list(views.name)
    for key, meaning in _VIEW_DATA.items():
        group.create_dataset(key, data=data[key]).attrs["unit"] = meaning


def read_truth(path: Path | str) -> Truth:
    """The truth of a place in the file. Raises InputError if it is missing, damaged, none or of another version."""
    return read_file(path, FORMAT, VERSION, _truth)


def read_file(path: Path | str, form: str, version: int, read: Callable[[Any], T]) -> T:
    """The result of `read` for a truth file of a named format. Raises InputError, also for all exceptions of `read`."""
    import h5py

    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: there is no such truth file; `phomo simulate` writes one beside site.toml")
    check_hdf5(path, "truth file", "simulate it again")
    try:
        with h5py.File(path, "r") as file:
            found = file.attrs.get("format")
            if found in FORMATS and found != form:
                raise InputError(f"{path}: is {FORMATS[found]}, where {FORMATS[form]} is wanted; check the path")
            if found != form:
                raise InputError(f"{path}: is an HDF5 file, but not the truth of a simulated site; check the path")
            if file.attrs["version"] != version:
                raise InputError(
                    f"{path}: has version {file.attrs['version']} of the format, this program reads "
                    f"{version}; simulate the site again"
                )
            truth = read(file)
    except InputError as error:
        raise InputError(f"{path}: {str(error).removeprefix(f'{path}: ')}; simulate it again") from error
    # A damaged file makes h5py raise nearly every built-in exception.
    except Exception as error:
        raise InputError(f"{path}: cannot be read as a truth file ({error}); simulate it again") from error
    _check(path, truth)
    return truth


def _check(path: Path, truth: SiteFacts) -> None:
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


def read_facts(file: Any) -> dict[str, Any]:
    """The content that `write_facts` wrote, by the names of the fields of a truth."""
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
        dark_level=np.zeros(len(cameras)),
        arc=np.zeros(len(cameras), int),
        **data,
    )
    return {
        "name": str(file.attrs["name"]),
        "body": str(file.attrs["body"]),
        "views": views,
        "psf_sigma_px": float(file.attrs["psf_sigma_px"]),
        "brightness": str(file.attrs["brightness"]),
        "photometry": from_dict(json.loads(file.attrs["photometry"])),
    }


def _truth(file: Any) -> Truth:
    facts, group = read_facts(file), file["surface"]
    surface = Surface(
        group["height"][()],
        group["albedo"][()],
        float(group.attrs["spacing_m"]),
        (float(group.attrs["origin_m"][0]), float(group.attrs["origin_m"][1])),
    )
    return Truth(surface=surface, **facts)
