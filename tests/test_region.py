"""The reference view and region: choices that follow from the score, and requests that cannot be met."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from photoclinometry.model.camera import Camera
from photoclinometry.model.errors import InputError, ReconstructionError
from photoclinometry.model.image import Image
from photoclinometry.model.sparse import SparseModel
from photoclinometry.sfm.region import (
    RegionOptions,
    choose_region,
    region_around,
)
from scenes import synthetic_images, synthetic_scene


@dataclass(frozen=True)
class Request:
    reference: str | None = None
    center_px: tuple[float, float] | None = None
    size_px: tuple[int, int] | None = None
    stride: int | None = None


SIZE = RegionOptions(size_px=(48, 48))


@pytest.fixture(scope="module")
def scene():
    return synthetic_scene(size=150, views=4)


@pytest.fixture(scope="module")
def images(scene):
    return synthetic_images(scene)


@pytest.fixture(scope="module")
def sparse(scene):
    """Every 60th landmark as a sparse point that all views observe."""
    count, views = len(scene.landmarks), len(scene.views)
    pick = np.arange(0, count, 60)
    return SparseModel(
        registered=np.ones(views, bool),
        body_from_cam=scene.views.body_from_cam,
        points=scene.landmarks.position[pick],
        point_start=np.arange(0, len(pick) * views + 1, views),
        point_view=np.tile(np.arange(views, dtype=np.int32), len(pick)),
        point_xy=scene.tracks.keypoint.reshape(count, views, 2)[pick].reshape(-1, 2),
        mean_reprojection_px=0.0,
    )


def choose(scene, sparse, images, request=None, options=SIZE):
    return choose_region(sparse, images, list(scene.views.cameras), scene.views.sun, request, options)


def test_the_view_from_the_zenith_is_chosen_when_nothing_else_differs(scene, sparse, images):
    same_sun = replace(scene, views=replace(scene.views, sun=np.tile(scene.views.sun[:1], (4, 1))))
    reference, region = choose(same_sun, sparse, images)
    assert reference == 0
    assert (region.width, region.height) == (48, 48)


def test_the_region_keeps_out_of_shadow(scene, sparse, images):
    """The left half of every image goes dark: the region is then in the right half."""
    half = scene.views.cameras[0].width // 2
    dark = [replace(image, brightness=image.brightness.copy()) for image in images]
    for image in dark:
        image.brightness[:, :half] *= 0.01
    _, region = choose(scene, sparse, dark, Request(reference=scene.views.name[0]))
    assert region.col >= half - 16


def test_the_region_keeps_out_of_invalid_pixels(scene, sparse, images):
    half = scene.views.cameras[0].height // 2
    valid = np.zeros_like(images[0].valid)
    valid[:half] = True
    _, region = choose(scene, sparse, [replace(i, valid=valid) for i in images])
    assert region.row + region.height <= half + 16


def test_a_request_is_met_exactly(scene, sparse, images):
    request = Request(reference=scene.views.name[2], center_px=(110.0, 90.0), size_px=(40, 30))
    reference, region = choose(scene, sparse, images, request)
    assert reference == 2
    assert (region.col, region.row, region.width, region.height) == (90, 75, 40, 30)


def test_the_default_size_is_cut_to_the_image(scene, sparse, images):
    _, region = choose(scene, sparse, images, options=RegionOptions())
    camera = scene.views.cameras[0]
    assert (region.width, region.height) == (camera.width, camera.height)


@pytest.mark.parametrize(
    ("request_", "message"),
    [
        (Request(center_px=(10.0, 100.0)), "outside of"),
        (Request(size_px=(4000, 30)), "does not fit"),
        (Request(reference="nobody.png"), "not a view"),
    ],
)
def test_an_impossible_request_is_refused_with_its_mistake(scene, sparse, images, request_, message):
    with pytest.raises(InputError, match=message):
        choose(scene, sparse, images, request_)


def with_finer(scene, sparse, views, factor):
    """The site with some views taken by a camera of longer focal length and as many times more pixels."""
    camera = scene.views.cameras[0]
    size = round(factor * camera.width)
    finer = Camera("PINHOLE", size, size, tuple(factor * value for value in camera.params))
    cameras = tuple(finer if k in views else camera for k in range(len(scene.views)))
    stretch = np.where(np.isin(sparse.point_view, views), factor, 1.0)
    seen = replace(scene, views=replace(scene.views, cameras=cameras))
    return seen, replace(sparse, point_xy=stretch[:, None] * sparse.point_xy)


@pytest.mark.parametrize(("finer", "chosen"), [([1, 2, 3], {1, 2, 3}), ([2, 3], {2, 3}), ([3], {0, 1, 2})])
def test_the_reference_is_as_fine_as_several_views_are(scene, sparse, finer, chosen):
    """The reference is one of two or three (of four) views of three times the resolution, but not a single such one."""
    seen, points = with_finer(scene, sparse, finer, 3)
    even = [np.ones((camera.height, camera.width), np.float32) for camera in seen.views.cameras]
    images = [Image(name, b, b > 0) for name, b in zip(seen.views.name, even, strict=True)]
    assert choose(seen, points, images)[0] in chosen


def test_a_reference_that_did_not_register_is_refused(scene, sparse, images):
    without = replace(sparse, registered=np.array([True, False, True, True]))
    with pytest.raises(InputError, match="did not register"):
        choose(scene, without, images, Request(reference=scene.views.name[1]))


def test_unlit_views_have_no_region(scene, sparse, images):
    night = replace(scene, views=replace(scene.views, sun=-scene.views.sun))
    with pytest.raises(ReconstructionError, match="no region is lit"):
        choose(night, sparse, images)


def test_the_stride_is_the_requests_or_else_the_options(scene, sparse, images):
    options = replace(SIZE, stride=3)
    assert choose(scene, sparse, images)[1].stride == 1
    assert choose(scene, sparse, images, options=options)[1].stride == 3
    assert choose(scene, sparse, images, Request(stride=4), options)[1].stride == 4
    assert choose(scene, sparse, images, Request(size_px=(48, 48)), options)[1].stride == 3


@pytest.mark.parametrize(("request_", "stride"), [(Request(stride=48), 1), (None, 60), (Request(size_px=(9, 40)), 9)])
def test_a_stride_as_wide_as_the_region_is_refused(scene, sparse, images, request_, stride):
    with pytest.raises(InputError, match=r"region\.stride \d+ leaves a single row of landmarks"):
        choose(scene, sparse, images, request_, replace(SIZE, stride=stride))


def test_a_region_reaches_the_edge_but_not_beyond(scene):
    camera = scene.views.cameras[0]
    assert region_around((20.0, 20.0), (40, 40), camera, "a").col == 0
    with pytest.raises(InputError, match="move center_px"):
        region_around((19.0, 20.0), (40, 40), camera, "a")
