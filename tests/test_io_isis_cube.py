"""ISIS cubes: stored values and special ones, tiles, tables, windows; real cubes as GDAL reads them; damage named."""

import numpy as np
import pytest

from archives import FORMATS, geometry_tables, needs_formats, texture, write_cube
from photoclinometry.io.archives.isis_cube import read_isis_cube
from photoclinometry.io.archives.product import Window
from photoclinometry.model.errors import ImageError, InputError


@pytest.mark.parametrize("order", ["Lsb", "Msb"])
@pytest.mark.parametrize("tile", [None, (40, 60), (16, 32)])
def test_pixels_are_those_that_were_stored(tmp_path, order, tile):
    pixels = texture()
    image = read_isis_cube(write_cube(tmp_path / "a.cub", pixels, order=order, tile=tile)).image
    assert image.valid.all()
    np.testing.assert_array_equal(image.brightness, pixels)


SPECIAL = [
    ("UnsignedByte", np.uint8, [0, 255], [1, 254]),
    ("SignedWord", np.int16, [-32768, -32767, -32766, -32765, -32764], [-32752, 0, 32767]),
    ("UnsignedWord", np.uint16, [0, 1, 2, 65534, 65535], [3, 65522]),
    (
        "Real",
        np.float32,
        [*np.array([0xFF7FFFFB, 0xFF7FFFFC, 0xFF7FFFFD, 0xFF7FFFFE, 0xFF7FFFFF], np.uint32).view(np.float32), np.nan],
        [-1e30, 0.0, 1e30],
    ),
]


@pytest.mark.parametrize(("kind", "dtype", "special", "ordinary"), SPECIAL, ids=[s[0] for s in SPECIAL])
def test_null_and_saturation_are_no_measurements(tmp_path, kind, dtype, special, ordinary):
    """The values of ISIS's SpecialPixel.h, and their nearest ordinary neighbours."""
    values = np.array([*special, *ordinary, *ordinary], dtype)
    pixels = np.stack([values, values])
    path = write_cube(tmp_path / "a.cub", pixels, kind=kind, base=10.0, multiplier=2.0)
    image = read_isis_cube(path).image
    expected = np.arange(len(values)) >= len(special)
    np.testing.assert_array_equal(image.valid, [expected, expected])
    np.testing.assert_allclose(image.brightness[0][expected], 10.0 + 2.0 * values[expected].astype(float), rtol=1e-6)
    assert (image.brightness[0][~expected] == 0).all()


@pytest.mark.filterwarnings("ignore:Dataset has no geotransform")
@pytest.mark.parametrize(("kind", "dtype", "special", "ordinary"), SPECIAL[1:], ids=[s[0] for s in SPECIAL[1:]])
def test_gdal_masks_the_same(tmp_path, kind, dtype, special, ordinary):
    rasterio = pytest.importorskip("rasterio")
    values = np.array([*special[:5], *ordinary], dtype)
    path = write_cube(tmp_path / "a.cub", np.stack([values, values]), kind=kind)
    with rasterio.open(path) as file:
        masked = np.ma.getmaskarray(file.read(1, masked=True))
    np.testing.assert_array_equal(read_isis_cube(path).image.valid, ~masked)


def test_tables_and_windows_are_read(tmp_path):
    tables = geometry_tables([1, 0, 0, 0], [1.5, -2.5, 3.5], [0, 1, 0, 0], [1e8, 2e8, -3e8])
    alpha = (
        "Group = AlphaCube\nAlphaStartingSample = 499.5\nAlphaStartingLine = 20.5\nAlphaEndingSample = 619.5\n"
        "AlphaEndingLine = 60.5\nBetaSamples = 60\nBetaLines = 40\nEnd_Group\n"
    )
    product = read_isis_cube(write_cube(tmp_path / "a.cub", texture(), groups=alpha, tables=tables))
    assert product.window == Window((499.0, 20.0), (2.0, 1.0))
    assert list(product.tables) == list(tables)
    assert product.tables["InstrumentPosition"]["J2000Y"] == [-2.5]


@pytest.mark.parametrize("path", sorted(FORMATS.glob("*/*.cub")), ids=lambda p: p.name)
@pytest.mark.data
@needs_formats
@pytest.mark.filterwarnings("ignore:Dataset has no geotransform")
def test_real_cubes_are_read_as_gdal_reads_them(path):
    rasterio = pytest.importorskip("rasterio")
    image = read_isis_cube(path).image
    with rasterio.open(path) as file:
        other = file.read(1, masked=True).astype(np.float64) * file.scales[0] + file.offsets[0]
    np.testing.assert_array_equal(image.valid, ~np.ma.getmaskarray(other))
    np.testing.assert_array_equal(image.brightness[image.valid], np.float32(other.data)[image.valid])


def spoilt(tmp_path, old, new):
    tables = geometry_tables([1, 0, 0, 0], [1, 2, 3], [0, 1, 0, 0], [1, 2, 3])
    path = write_cube(tmp_path / "bad.cub", texture(), tile=(20, 30), tables=tables)
    data = path.read_bytes()
    assert old in data
    label = data[:65536].rstrip(b"\0").replace(old, new, 1)
    path.write_bytes(label.ljust(65536, b"\0") + data[65536:])
    return path


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (b"Lines = 40", b"Lines = 4000", "ends after"),
        (b"Lines = 40", b"Lines = 1", "1 lines of 60 samples"),
        (b"Lines = 40", b"Lines = -3", "LINES is -3"),
        (b"Samples = 60", b"Samples = 1000000000", "more than"),
        (b"Samples = 60", b"Samples = x", "SAMPLES is 'x'"),
        (b"Bands = 1", b"Bands = 3", "3 bands"),
        (b"Type = Real", b"Type = Reel", "type 'Reel'"),
        (b"TileLines = 20", b"TileLines = 0", "tiles of 30 x 0"),
        (b"TileLines = 20", b"TileLines = 90", "tiles of 30 x 90"),
        (b"StartByte = 65537", b"StartByte = 0", "before the file's beginning|expected a whole number"),
        (b"Base = 0.0", b"Base = 1e999", "BASE"),
        (b"Object = Core", b"Object = Cord", "without pixels"),
        (b"Records = 1", b"Records = 9", "does not fit"),
        (b"Type = Double", b"Type = Dubble", "field of type 'DUBBLE'"),
        (b"Bytes = 32", b"Bytes = 99999999999", "does not fit"),
    ],
)
def test_lying_labels_are_refused(tmp_path, old, new, message):
    with pytest.raises(ImageError, match=rf"bad\.cub: .*({message})"):
        read_isis_cube(spoilt(tmp_path, old, new))


def test_a_cube_that_was_cut_short_is_refused(tmp_path):
    tables = geometry_tables([1, 0, 0, 0], [1, 2, 3], [0, 1, 0, 0], [1, 2, 3])
    data = write_cube(tmp_path / "cut.cub", texture(), tables=tables).read_bytes()
    for length in (0, 1, 100, 700, 65536, 70000, 65536 + 40 * 60 * 4, len(data) - 1):
        (tmp_path / "cut.cub").write_bytes(data[:length])
        with pytest.raises(InputError, match=r"cut\.cub: "):
            read_isis_cube(tmp_path / "cut.cub")
