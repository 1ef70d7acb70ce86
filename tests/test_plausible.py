"""Brightness that no ground has is refused, or its view is named; what ground and cameras can have is accepted."""

import logging
import re
import struct
import zlib
from dataclasses import replace

import numpy as np
import pytest

from archives import FORMATS, SHARED, needs_formats
from photoclinometry.ingest.exposure import AuxiliaryData, read_exposure
from photoclinometry.ingest.options import IngestOptions
from photoclinometry.io.archives.archive import read_product
from photoclinometry.io.images import read_image, write_fits, write_png
from photoclinometry.io.masks import Masking
from photoclinometry.io.plausible import impossible_views, overexposed
from photoclinometry.io.site import Site, SiteView, read_site, write_site
from photoclinometry.io.site_images import load_images
from photoclinometry.io.suns_csv import SunRow
from photoclinometry.model.errors import ImageError, InputError, SiteError
from photoclinometry.model.geometry import Rigid
from photoclinometry.model.image import Image
from photoclinometry.model.sparse import SparseModel, among_more_views
from photoclinometry.pipeline.folder.run_folder import open_run
from photoclinometry.pipeline.sparse_stages import PosedImages, SparseReconstruction, choose_views, read_inputs
from sites import SIZE, picture, write_small_site


def site_of(folder, change=lambda number, iof: iof, views=6):
    """A small site whose images were changed."""
    path = write_small_site(folder, views)
    for number in range(views):
        write_fits(folder / "images" / f"{number}.fits", change(number, picture(number)).astype(np.float32))
    return read_site(path)


def judged(site):
    return impossible_views(site, load_images(site))


WRONG_SITES = {
    "per cent": (
        lambda n, x: 100 * x,
        r"6 of 6 images are above 1\.5, brighter than any sunlit ground.*divide per cent by 100",
    ),
    "counts": (lambda n, x: np.round(3e5 * x), r"are whole numbers, as a detector counts: write brightness = \"dn\""),
    "radiance": (lambda n, x: 1e-6 * x, r"dimmer than any sunlit ground .*if this is radiance, convert it to I/F"),
    "counts in most": (lambda n, x: np.round(3e5 * x) if n else x, r"5 of 6 images are above 1\.5"),
}


@pytest.mark.parametrize("fault", WRONG_SITES)
def test_another_quantity_called_iof_is_refused_with_what_to_write(tmp_path, fault):
    change, said = WRONG_SITES[fault]
    site = site_of(tmp_path, change)
    with pytest.raises(SiteError, match=r'site\.toml: brightness: is "iof", but .*' + said):
        judged(site)
    if fault != "radiance":
        assert judged(replace(site, brightness="dn")) == {}


def _clipped(x):
    return np.minimum(x, np.quantile(x, 0.6))


WRONG_VIEWS = {
    "counts": (lambda x: 3e5 * x, "iof", r"its ground has I/F .*, ground has 1\.5 at most"),
    "per mille, but possible": (
        lambda x: 10.5 * x,
        "iof",
        "times as bright as that of the typical view|ground has 1.5",
    ),
    "a tenth and less": (lambda x: x / 30, "iof", r"(29\.\d|30) times as dim as .* which no phase angle explains"),
    "negative": (lambda x: -x, "iof", r"its brightness is negative \(median -0\.1"),
    "wrapped counts": (lambda x: 1e4 * x - 32768, "dn", "its brightness is negative"),
    "overexposed": (
        _clipped,
        "iof",
        r"its highest brightness, 0\.1\d*, is that of 40 % of its pixels: it is overexposed",
    ),
    "overexposed counts": (lambda x: np.round(1e4 * _clipped(x)), "dn", "40 % of its pixels: it is over"),
}


@pytest.mark.parametrize("fault", WRONG_VIEWS)
def test_one_view_of_impossible_brightness_is_named_and_left_out(tmp_path, caplog, fault):
    change, brightness, said = WRONG_VIEWS[fault]
    scale = 1.0 if brightness == "iof" else 1e4
    site = site_of(tmp_path, lambda n, x: change(x) if n == 2 else scale * x)
    site = replace(site, brightness=brightness)
    with caplog.at_level(logging.WARNING):
        inputs = read_inputs(open_run(tmp_path / "run"), site).value
    assert list(inputs.unusable) == ["images/2.fits"]
    assert re.search(said, inputs.unusable["images/2.fits"])
    (record,) = [r for r in caplog.records if "left out" in r.getMessage()]
    assert record.getMessage().startswith("images/2.fits is left out: its ")
    assert (record.__dict__["code"], record.__dict__["view"]) == ("brightness-impossible", "images/2.fits")


EMPTY_VIEWS = {
    "NaN": (lambda x: np.full_like(x, np.nan), r"it has no valid pixel \(all NaN, .*\); remove this view, or correct"),
    "constant": (lambda x: np.full_like(x, -32768.0), r"it is constant: all its valid pixels are -32768, .*remove"),
    "dark": (lambda x: 1e-4 * np.random.default_rng(0).normal(size=x.shape), r"it is dark: nothing rises .*remove"),
}


@pytest.mark.parametrize("brightness", ["iof", "dn"])
@pytest.mark.parametrize("fault", EMPTY_VIEWS)
def test_views_that_show_nothing_are_named_and_left_out(tmp_path, caplog, fault, brightness):
    """Two, which are not called the same image; the others have the dark level that they have alone."""
    change, said = EMPTY_VIEWS[fault]
    site = replace(site_of(tmp_path, lambda n, x: change(x) if n in (2, 4) else x), brightness=brightness)
    with caplog.at_level(logging.WARNING):
        inputs = read_inputs(open_run(tmp_path / "run"), site).value
    assert list(inputs.unusable) == ["images/2.fits", "images/4.fits"]
    assert all(re.search(said, reason) for reason in inputs.unusable.values())
    left_out = [r for r in caplog.records if "left out" in r.getMessage()]
    assert [r.__dict__["code"] for r in left_out] == 2 * ["view-empty"]
    assert [r.__dict__["view"] for r in left_out] == list(inputs.unusable)
    alone = load_images(replace(site, views=tuple(v for k, v in enumerate(site.views) if k not in (2, 4))))
    for image, own in zip([image for image in inputs.images if image.name not in inputs.unusable], alone, strict=True):
        np.testing.assert_array_equal(image.brightness, own.brightness)


def test_a_view_whose_mask_leaves_nothing_is_left_out(tmp_path):
    site = site_of(tmp_path)
    write_png(tmp_path / "mask.png", np.zeros((SIZE, SIZE), np.uint8))
    views = list(site.views)
    views[3] = replace(views[3], masking=Masking(files=(tmp_path / "mask.png",)))
    inputs = read_inputs(open_run(tmp_path / "run"), replace(site, views=tuple(views))).value
    assert list(inputs.unusable) == ["images/3.fits"]


def test_too_few_sound_views_are_an_error_that_names_the_others(tmp_path):
    site = site_of(tmp_path, lambda n, x: -x if n in (0, 3) else x, views=4)
    with pytest.raises(
        ImageError, match=r"2 of 4 images cannot be used, 3 must remain: images/0\.fits: its brightness"
    ):
        judged(site)


def test_phase_may_dim_a_view_as_far_as_physics_says(tmp_path):
    """0.05 mag/deg over 80 degrees is a factor of 40: a view as dim as 1/30 is sound at that phase, and not at none."""
    site = site_of(tmp_path, lambda n, x: x / 30 if n == 2 else x)
    far, near = np.array([np.sin(2.0), 0, -np.cos(2.0)]), np.array([0.0, 0.0, -1.0])
    turned = [replace(v, sun=far if n == 2 else near) for n, v in enumerate(site.views)]
    assert judged(replace(site, views=tuple(turned))) == {}
    level = [replace(v, sun=near) for v in site.views]
    assert list(judged(replace(site, views=tuple(level)))) == ["images/2.fits"]


def test_uncalibrated_views_may_have_any_exposure(tmp_path):
    site = replace(site_of(tmp_path, lambda n, x: 10.0**n * x), brightness="dn")
    assert judged(site) == {}


def noise(counts, seed=0):
    return np.round(np.random.default_rng(seed).normal(100, counts, (SIZE, SIZE)))


@pytest.mark.parametrize(
    "values",
    [noise(3), noise(1), np.minimum(noise(40), 160), np.repeat(np.arange(8.0), 512).reshape(SIZE, SIZE)],
    ids=["coarse", "very coarse", "a few at the top", "eight steps"],
)
def test_coarse_counts_and_single_saturated_pixels_are_not_overexposure(values):
    assert overexposed(Image("a", values.astype(np.float32), np.ones(values.shape, bool))) is None


def test_a_model_of_some_views_is_one_of_all():
    count = 4
    model = SparseModel(
        registered=np.array([True, True, False, True]),
        body_from_cam=Rigid(np.tile(np.eye(3), (count, 1, 1)), np.arange(12.0).reshape(4, 3)),
        points=np.zeros((2, 3)),
        point_start=np.array([0, 2, 5]),
        point_view=np.array([0, 1, 0, 1, 3], np.int32),
        point_xy=np.zeros((5, 2)),
        mean_reprojection_px=0.1,
        reason=np.array(["", "", "matched nothing", ""]),
    )
    used = np.ones(count + 1, bool)
    used[1] = False
    more = among_more_views(model, used, ["", "too bright", *[""] * (count - 1)])
    assert more.why_unregistered() == {1: "too bright", 3: "matched nothing"}
    assert more.registered.tolist() == [*model.registered[:1], False, *model.registered[1:]]
    np.testing.assert_array_equal(more.body_from_cam.translation[used], model.body_from_cam.translation)
    assert set(more.point_view) == {v + (v >= 1) for v in set(model.point_view.tolist())}


def png_with(path, kind, body):
    """A grey PNG with one more chunk after its header."""
    write_png(path, (1e4 * picture(0)).astype(np.uint16))
    data, chunk = path.read_bytes(), kind + body
    path.write_bytes(
        data[:33] + struct.pack(">I", len(body)) + chunk + struct.pack(">I", zlib.crc32(chunk)) + data[33:]
    )
    return path


ENCODED = {
    "gamma": (b"gAMA", struct.pack(">I", 45455), r"gamma 0\.45\d*"),
    "sRGB": (b"sRGB", b"\0", "sRGB"),
    "profile": (b"iCCP", b"x\0\0" + zlib.compress(b""), "a colour profile"),
    "video": (b"cICP", bytes([1, 13, 0, 1]), "code points for video, transfer 13"),
}


@pytest.mark.parametrize("chunk", ENCODED)
def test_a_png_that_declares_an_encoding_for_the_eye_is_refused_unless_stated(tmp_path, chunk):
    kind, body, said = ENCODED[chunk]
    path = png_with(tmp_path / "a.png", kind, body)
    with pytest.raises(ImageError, match=rf"a\.png: declares that its numbers are not linear in radiance \({said}\)"):
        read_image(path)
    assert read_image(path, linear=True).valid.all()
    with pytest.raises(ImageError, match="or pass --linear if its numbers are linear"):
        read_product(path)
    suns = {"a.png": SunRow(np.array([0.6, 0.0, -0.8]), None)}
    about = {"pinhole": (640.0, 640.0, 32.0, 32.0)}
    assert read_exposure(path, IngestOptions(**about, linear=True), AuxiliaryData(suns=suns)).image.valid.any()


@pytest.mark.parametrize(("kind", "body"), [(b"gAMA", struct.pack(">I", 100_000)), (b"cICP", bytes([1, 8, 0, 1]))])
def test_a_png_that_declares_linear_numbers_is_read(tmp_path, kind, body):
    assert read_image(png_with(tmp_path / "a.png", kind, body)).valid.all()


def test_a_site_states_that_its_png_files_are_linear(tmp_path):
    path = write_small_site(tmp_path)
    png_with(tmp_path / "images" / "1.png", b"sRGB", b"\0").replace(tmp_path / "images" / "1.fits")
    text = path.read_text().replace('"iof"', '"dn"')
    path.write_text(text)
    with pytest.raises(ImageError, match=r"1\.fits: .*or write linear = true in site\.toml if"):
        load_images(read_site(path))
    path.write_text(text.replace('brightness = "dn"', 'brightness = "dn"\nlinear = true'))
    site = read_site(path)
    assert len(load_images(site)) == 4
    write_site(tmp_path / "again.toml", site)
    assert read_site(tmp_path / "again.toml").linear
    path.write_text(text.replace('brightness = "dn"', 'brightness = "dn"\nlinear = "yes"'))
    with pytest.raises(SiteError, match="linear: expected true or false, found 'yes'"):
        read_site(path)


def test_a_jpeg_is_refused_for_what_it_is(tmp_path):
    (tmp_path / "a.jpg").write_bytes(b"\xff\xd8\xff\xe0rest")
    with pytest.raises(ImageError, match=r"a\.jpg: is a JPEG, whose numbers are not linear"):
        read_image(tmp_path / "a.jpg")


@needs_formats
def test_real_images_are_accepted():
    """Calibrated images of Bennu, Eros and the Moon, and four stretched ones of Vesta."""
    site = read_site(SHARED / "vesta-opnav022" / "site.toml")
    assert judged(site) == {}
    calibrated = [*FORMATS.glob("phocube/*.cub"), *FORMATS.glob("near/*/m0*iof*.lbl"), *FORMATS.glob("lronacpho/*.cub")]
    assert len(calibrated) >= 4
    for path in calibrated:
        image = read_product(path).image
        one = replace(site, brightness="iof", views=site.views[:3])
        assert impossible_views(one, [replace(image, name=v.name) for v in one.views]) == {}, path
    with pytest.raises(InputError):
        impossible_views(replace(site, brightness="iof"), load_images(site))


def test_a_view_in_another_unit_leaves_poses_of_the_others(tmp_path):
    """Through reading and structure from motion; the reason is the one that the log gave."""
    from sparse_views import CAMERA, OPTIONS, painted_site

    views = []
    for k, image in enumerate(painted_site(count=5, seed=0, prefix="a")[0]):
        iof = 0.1 * image.brightness / np.median(image.brightness)
        write_fits(tmp_path / image.name, 1000 * iof if k == 2 else iof)
        views.append(SiteView(image.name, tmp_path / image.name, CAMERA, np.array([0.6, 0.0, -0.8])))
    write_site(tmp_path / "site.toml", Site("a", None, "iof", tuple(views), None, tmp_path / "site.toml"))
    folder = open_run(tmp_path / "run")
    inputs = read_inputs(folder, read_site(tmp_path / "site.toml"))
    sparse = folder.result_of(SparseReconstruction(inputs=inputs, options=OPTIONS))
    assert sparse.value.registered.tolist() == [True, True, False, True, True]
    chosen = choose_views(folder, PosedImages(inputs=inputs, sparse=sparse), np.zeros(5, bool), None)
    assert chosen.left_out == inputs.value.unusable
