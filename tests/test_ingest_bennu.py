"""A real image with its SUMFILE and a shape: the shape, rendered as the SUMFILE says, is what the image shows."""

import numpy as np
import pytest

from archives import FORMATS, needs_formats
from photoclinometry.ingest.ingest import ingest
from photoclinometry.ingest.options import IngestOptions
from photoclinometry.io.meshes.obj import read_obj
from photoclinometry.model.geometry import Rigid, unit
from photoclinometry.model.reflectance import published
from photoclinometry.model.region import Region
from photoclinometry.model.scene import Landmarks, Scene, Tracks, Views
from photoclinometry.photometry.render import draw_landmarks, landmark_brightness

SPC = FORMATS / "spc"


def shape_scene(exposure):
    """The shape's vertices as landmarks of equal albedo, in the view of one exposure; and its facets. Metres."""
    vertices, faces = read_obj(SPC / "Bennu49k.obj")
    vertices, same = np.unique((1000.0 * vertices).round(3), axis=0, return_inverse=True)
    faces = same.reshape(-1)[faces]
    corner = vertices[faces]
    facet = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    normal = np.zeros_like(vertices)
    for k in range(3):
        np.add.at(normal, faces[:, k], facet)
    pose = exposure.prior.cam_from_body.inverse()
    count = len(vertices)
    scene = Scene(
        name="bennu",
        body="bennu",
        brightness="iof",
        reflectance=published("mcewen"),
        views=Views(
            name=("a",),
            cameras=(exposure.camera,),
            body_from_cam=Rigid(pose.rotation[None], pose.translation[None]),
            sun=(pose.rotation @ exposure.sun)[None],
            scale=np.ones(1),
            bias=np.zeros(1),
            dark_level=np.zeros(1),
            sun_measured=exposure.sun[None],
            sun_sigma=np.full(1, 1e-3),
            sun_common_sigma=np.zeros(1),
            arc=np.zeros(1, int),
        ),
        landmarks=Landmarks(
            position=vertices, normal=unit(normal), albedo=np.ones(count), pixel=np.zeros((count, 2), np.int32)
        ),
        tracks=Tracks(
            start=np.zeros(count + 1, np.int64),
            view=np.zeros(0, np.int32),
            keypoint=np.zeros((0, 2)),
            keypoint_sigma=np.zeros(0),
            brightness=np.zeros(0),
            lit=np.zeros(0, bool),
        ),
        reference=0,
        region=Region.of_image(2, 2),
    )
    return scene, faces


@pytest.mark.data
@needs_formats
def test_the_rendered_shape_is_what_the_image_shows(tmp_path):
    """The image's lines run against the SUMFILE's, hence "up". Correlation 0.88 over the image (0.48 over the body:
    phase angle 6 degrees, boulders below the shape's facets), and 96 % of the body's outline in common; for any other
    orientation of the image 0.37 at most.
    """
    options = IngestOptions(sumfiles=(SPC / "M605862153F5.SUM",), body="bennu", lines="up")
    image = SPC / "ocams20190314t190123s972_map_iofl2pan_77236.png"
    (exposure,) = ingest([image], tmp_path / "site", options).exposures
    scene, faces = shape_scene(exposure)
    rendered, mask = draw_landmarks(scene, 0, landmark_brightness(scene, 0), faces)
    shown = exposure.image.brightness

    def likeness(picture):
        return np.corrcoef(rendered.ravel(), picture.ravel())[0, 1]

    assert likeness(shown) > 0.86
    assert np.corrcoef(rendered[mask], shown[mask])[0, 1] > 0.45
    for other in (shown[::-1], shown[:, ::-1], shown[::-1, ::-1], shown.T):
        assert likeness(other) < 0.4
    from scipy.ndimage import gaussian_filter

    body = gaussian_filter(shown, 3) > 0.2 * np.median(shown[mask])
    assert (body & mask).sum() / (body | mask).sum() > 0.95
