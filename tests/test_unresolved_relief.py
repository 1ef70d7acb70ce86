"""Relief finer than the images resolve, as an error of positions."""

from dataclasses import replace

import numpy as np
import pytest

from photoclinometry.adjust.covariance.resolution import BLUR_PX, FINEST, unresolved_relief
from photoclinometry.surface.relief import local_frame
from scenes import synthetic_scene


@pytest.fixture(scope="module")
def flat():
    """A plane, tilted against the frame B."""
    scene = synthetic_scene(size=60, views=4)
    row, col = scene.cells
    position = np.stack([col, row, 0.3 * col - 0.2 * row], -1) * scene.gsd
    return replace(scene, landmarks=replace(scene.landmarks, position=position))


def test_a_plane_hides_nothing_not_even_at_its_edges(flat):
    np.testing.assert_allclose(unresolved_relief(flat), 0.0, atol=1e-20)


@pytest.mark.parametrize("length_px", [4.0, 8.0])
def test_a_wave_is_as_uncertain_as_what_a_gaussian_takes_off_it(flat, length_px):
    """A Gaussian of standard deviation s leaves exp(-2 (pi s / length)^2) of the wave; along the plane's normal."""
    row, _ = flat.cells
    up, size = local_frame(flat).rotation[:, 2], 0.1 * flat.gsd
    wave = size * np.sin(2 * np.pi * row / length_px)
    landmarks = flat.landmarks
    rough = replace(flat, landmarks=replace(landmarks, position=landmarks.position + wave[:, None] * up))
    found, up = unresolved_relief(rough), local_frame(rough).rotation[:, 2]
    taken = 1.0 - np.exp(-2.0 * (np.pi * FINEST / length_px) ** 2)
    inner = (row > 10) & (row < 49)
    assert np.mean(found[inner] @ up @ up) == pytest.approx(0.5 * (size * taken) ** 2, rel=0.05)
    across = np.cross(up, [1.0, 0.0, 0.0])
    np.testing.assert_allclose(found @ across, 0.0, atol=1e-9 * size**2)


def test_of_coarser_maps_the_same_waves_between_landmarks_hide_less_as_their_images_blur_less_of_them(flat):
    """Images of two pixels a landmark: blurred by 0.7 px themselves, then by sqrt(3) / 2 px to the grid."""
    row, col = flat.cells
    wave = 0.1 * flat.gsd * np.sin(2 * np.pi * row / 5.0) * np.cos(2 * np.pi * col / 7.0)
    landmarks = flat.landmarks
    position = landmarks.position + wave[:, None] * local_frame(flat).rotation[:, 2]
    fine = replace(flat, landmarks=replace(landmarks, position=position))
    region, first = fine.region, np.array([fine.region.row, fine.region.col])
    coarse = replace(
        fine,
        region=replace(region, height=2 * region.height, width=2 * region.width, stride=2),
        landmarks=replace(fine.landmarks, pixel=first + 2 * (landmarks.pixel - first)),
    )
    share = (BLUR_PX**2 + 0.75) / 4.0 / BLUR_PX**2
    np.testing.assert_allclose(unresolved_relief(coarse), share * unresolved_relief(fine), rtol=1e-12)
