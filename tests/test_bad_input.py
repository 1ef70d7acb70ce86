"""Every mistake in what a person gives is answered by name: the file, the view, the key, and the remedy."""

from pathlib import Path

import numpy as np
import pytest

from photoclinometry.io.images import read_image, write_fits, write_png
from photoclinometry.io.site import read_site, write_site
from photoclinometry.io.site_images import load_images
from photoclinometry.model.errors import ImageError, InputError, SiteError
from sites import SIZE, picture, view_text, write_small_site


@pytest.fixture
def path(tmp_path):
    return write_small_site(tmp_path)


SUN = "sun = [0.6, 0.0, -0.8]"
PRIOR = "cam_from_body = {{ rotation_wxyz = {}, translation = [0, 0, 9], sigma_deg = 0.1, sigma = 1 }}"


def test_another_body_is_accepted_with_its_radius_and_cameras_outside_of_it(path):
    text = path.read_text().replace('"vesta"', '"tatooine"\nbody_radius_m = 5000')
    path.write_text(text)
    site = read_site(path)
    assert (site.body, site.body_radius_m) == ("tatooine", 5000.0)
    write_site(path.with_name("again.toml"), site)
    assert read_site(path.with_name("again.toml")).body_radius_m == 5000.0
    path.write_text(
        text.replace(SUN, SUN + "\n" + PRIOR.format("[1, 0, 0, 0]"), 1).replace("{{", "{").replace("}}", "}")
    )
    with pytest.raises(
        SiteError, match=r"body_radius_m: is 5000 m, but cam_from_body of images/0\.fits is 9 m from its centre.*metres"
    ):
        read_site(path)


def test_fewer_than_three_views_are_refused(path):
    text = path.read_text()
    path.write_text(text[: text.index("[region]")] + view_text(0) + view_text(1))
    with pytest.raises(SiteError, match=r"site\.toml: views: there are 2, at least 3 are needed"):
        read_site(path)
    path.write_text(text[: text.index("[region]")])
    with pytest.raises(SiteError, match=r"site\.toml: views: there are 0, at least 3 are needed; add \[\[views\]\]"):
        read_site(path)


def test_a_site_file_that_is_none_is_refused(tmp_path):
    with pytest.raises(SiteError, match=r"no\.toml: there is no such file; give a site\.toml"):
        read_site(tmp_path / "no.toml")
    with pytest.raises(SiteError, match=r"cannot be read: Is a directory; give a site\.toml"):
        read_site(tmp_path)
    (tmp_path / "image.toml").write_bytes(b"\x89PNG\xff\xfe")
    with pytest.raises(SiteError, match=r"image\.toml: is not UTF-8 text"):
        read_site(tmp_path / "image.toml")


def test_an_image_path_that_is_missing_or_a_folder_is_named(tmp_path):
    with pytest.raises(ImageError, match=r"none\.fits: there is no such image; check the path"):
        read_image(tmp_path / "none.fits")
    with pytest.raises(ImageError, match=r"cannot be read: Is a directory"):
        read_image(tmp_path)


@pytest.mark.parametrize("noise", [0.0, 1e-4])
def test_an_all_dark_frame_is_named(path, noise):
    dark = noise * np.random.default_rng(0).normal(size=(SIZE, SIZE))
    write_fits(path.parent / "images" / "1.fits", dark)
    with pytest.raises(ImageError, match=r"1\.fits: is dark: nothing rises above its noise .* remove this view"):
        load_images(read_site(path))


NOTHING = {
    "saturated below the container's top": (
        np.full((SIZE, SIZE), 4095.0),
        r"is constant: all its valid pixels are 4095, ",
    ),
    "pure noise": (
        np.random.default_rng(0).normal(0.2, 0.01, (SIZE, SIZE)),
        r"is noise alone: 0\.(2|19)\d* with a standard deviation of 0\.0\d* and no detail",
    ),
    "saturated noise": (
        np.random.default_rng(0).normal(4000, 3, (SIZE, SIZE)),
        r"is noise alone: [\d.]+ with a standard deviation of [23]",
    ),
}


@pytest.mark.parametrize("fault", NOTHING)
def test_a_frame_without_detail_is_not_called_dark_unless_it_is(path, fault):
    values, said = NOTHING[fault]
    write_fits(path.parent / "images" / "1.fits", values)
    with pytest.raises(ImageError, match=rf"1\.fits: {said}.*remove this view"):
        load_images(read_site(path))


@pytest.mark.parametrize("kept", [100, 2880, 5000, 16000])
@pytest.mark.parametrize("checksum", [True, False])
def test_a_fits_file_that_was_cut_short_is_called_that(tmp_path, kept, checksum):
    from astropy.io import fits

    path = tmp_path / "a.fits"
    if checksum:
        write_fits(path, picture(0))
    else:
        fits.PrimaryHDU(picture(0)).writeto(path)
    path.write_bytes(path.read_bytes()[:kept])
    with pytest.raises(
        ImageError, match=rf"a\.fits: was cut short: it ends after {kept} bytes.* fetch or export it again"
    ):
        read_image(path)


def test_a_site_without_views_is_told_so_whatever_its_region(path):
    text = path.read_text()
    head = text[: text.index("[region]")]
    path.write_text(head + "[region]\nsize_px = [40, 20]\n")
    with pytest.raises(SiteError, match=r"views: there are 0, at least 3 are needed; add \[\[views\]\]"):
        read_site(path)


def spoilt(content: bytes, rng: np.random.Generator):
    """Truncations and flipped bytes of a file."""
    for size in rng.integers(0, len(content), 15):
        yield content[:size]
    for count in rng.integers(1, 4, 60):
        data = bytearray(content)
        for at in rng.integers(0, len(data), count):
            data[at] = rng.integers(256)
        yield bytes(data)


def write_examples(folder: Path) -> dict:
    """One small valid file of each format, with what reads it."""
    import cv2

    from photoclinometry.io.meshes.ply import read_ply, write_ply
    from photoclinometry.io.models.colmap import read_colmap, write_colmap
    from photoclinometry.io.scene_file import read_scene, write_scene
    from scenes import synthetic_scene

    scene = synthetic_scene(size=3, views=3)
    bytes_of_image = (1000 * picture(0)).astype(np.uint8)
    write_fits(folder / "a.fits", picture(0)[:8, :8])
    write_png(folder / "a.png", bytes_of_image[:16, :16])
    cv2.imwrite(str(folder / "a.tiff"), bytes_of_image[:16, :16])
    write_ply(folder / "a.ply", scene, mesh=True)
    write_scene(folder / "a.h5", scene)
    write_colmap(folder / "sparse", scene)
    write_small_site(folder)

    def model(path):
        return read_colmap(path.parent)

    readers = {"a.fits": read_image, "a.png": read_image, "a.tiff": read_image, "a.ply": read_ply, "a.h5": read_scene}
    return readers | {"site.toml": read_site, "sparse/images.bin": model, "sparse/points3D.bin": model}


@pytest.mark.parametrize(
    "name", ["a.fits", "a.png", "a.tiff", "a.ply", "a.h5", "site.toml", "sparse/images.bin", "sparse/points3D.bin"]
)
def test_damaged_files_are_read_or_refused_never_a_crash(tmp_path, name):
    """Whatever the damage, a reader either returns or raises our own InputError that names the file."""
    reader = write_examples(tmp_path)[name]
    path = tmp_path / name
    content = path.read_bytes()
    refused = []
    for data in spoilt(content, np.random.default_rng(0)):
        path.write_bytes(data)
        try:
            reader(path)
        except InputError as error:
            refused.append(str(error))
    assert len(refused) >= 10
    assert all(path.name in message for message in refused)
