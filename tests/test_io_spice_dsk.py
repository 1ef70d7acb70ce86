"""Shape kernels: SPICE's own routines find the surface where it is."""

import subprocess
import sys

import numpy as np
import pytest

from archives import SHARED
from photoclinometry.io import spice_dsk
from photoclinometry.io.child import Child
from photoclinometry.io.meshes.obj import read_obj
from photoclinometry.io.spice_dsk import DskPlace, write_dsk
from photoclinometry.model.errors import InputError
from photoclinometry.model.geometry import unit
from photoclinometry.surface.closed_mesh import area_vectors, icosahedron, refine
from photoclinometry.surface.radial_rays import RadialRays

spice = pytest.importorskip("spiceypy")

BENNU = 2101955
COMET = SHARED / "shapes" / "67p.obj"


@pytest.fixture(scope="module")
def egg():
    direction, faces = refine(*icosahedron(), 0.15, unit)
    x, y, z = direction.T
    return 250.0 * (1.0 + 0.25 * x + 0.15 * x * y + 0.1 * z * z)[:, None] * direction, faces


@pytest.fixture
def kernel(tmp_path, egg):
    """The path of a loaded kernel of the egg."""
    path = tmp_path / "egg.bds"
    place = DskPlace(body="bennu", surface=7)
    assert write_dsk(path, *egg, place=place, single_valued=True, comments=["an egg"]) == (BENNU, "IAU_BENNU")
    spice.furnsh(str(path))
    yield path
    spice.kclear()


def test_spice_reads_the_mesh_back(kernel, egg):
    handle = spice.dasopr(str(kernel))
    segment = spice.dlabfs(handle)
    vertices, plates = spice.dskz02(handle, segment)
    assert (vertices, plates) == (len(egg[0]), len(egg[1]))
    np.testing.assert_allclose(spice.dskv02(handle, segment, 1, vertices), 1e-3 * egg[0], rtol=1e-15)
    np.testing.assert_array_equal(spice.dskp02(handle, segment, 1, plates) - 1, egg[1])
    descriptor = spice.dskgd(handle, segment)
    assert (descriptor.center, descriptor.surfce, descriptor.dtype) == (BENNU, 7, 2)
    assert spice.frmnam(descriptor.frmcde) == "IAU_BENNU"
    spice.dascls(handle)
    assert b"an egg" in kernel.read_bytes()


def test_rays_of_spice_meet_the_surface(kernel, egg):
    """dskxv and srfnrm: from outside towards the middle, the point of our own rays and the normal of its plate."""
    rays = RadialRays(*egg)
    d = unit(np.random.default_rng(0).normal(size=(300, 3)))
    radius, face, _ = rays.outermost(d)
    normals = unit(area_vectors(*egg))
    points, found = spice.dskxv(False, "BENNU", [], 0.0, "IAU_BENNU", 2.0 * d, -d)
    assert np.all(found)
    np.testing.assert_allclose(points, 1e-3 * radius[:, None] * d, rtol=1e-9, atol=1e-12)
    normals = spice.srfnrm("DSK/UNPRIORITIZED", "BENNU", 0.0, "IAU_BENNU", points)
    np.testing.assert_allclose(normals, unit(area_vectors(*egg))[face], atol=1e-9)


def test_surface_points_by_longitude_and_latitude(kernel, egg):
    """latsrf."""
    lon_lat = np.random.default_rng(1).uniform([-np.pi, -1.5], [np.pi, 1.5], (200, 2))
    points = np.array(spice.latsrf("DSK/UNPRIORITIZED", "BENNU", 0.0, "IAU_BENNU", lon_lat.tolist()))
    lon, lat = lon_lat.T
    d = np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)], -1)
    np.testing.assert_allclose(points, 1e-3 * RadialRays(*egg).outermost(d)[0][:, None] * d, rtol=1e-9, atol=1e-12)


@pytest.mark.skipif(not COMET.is_file(), reason="no ../shared/data/shapes/67p.obj beside the repository")
def test_a_concave_body_is_met_where_it_is_met_first(tmp_path):
    """Rays from outside that meet the comet up to five times."""
    vertices, faces = read_obj(COMET)
    write_dsk(tmp_path / "67p.bds", 1e3 * vertices, faces, place=DskPlace(body="bennu"), single_valued=False)
    spice.furnsh(str(tmp_path / "67p.bds"))
    d = unit(np.random.default_rng(0).normal(size=(500, 3)))
    points, found = spice.dskxv(False, "BENNU", [], 0.0, "IAU_BENNU", 3.0 * d, -d)
    spice.kclear()
    assert np.all(found)
    np.testing.assert_allclose(points, RadialRays(vertices, faces).outermost(d)[0][:, None] * d, atol=1e-9)


def test_an_own_body_takes_its_frame_kernel(tmp_path, egg):
    frame = tmp_path / "egg.tf"
    frame.write_text(
        "KPL/FK\n\\begindata\nNAIF_BODY_NAME += 'EGG'\nNAIF_BODY_CODE += 20999999\nFRAME_EGG_FIXED = 1999999\n"
        "FRAME_1999999_NAME = 'EGG_FIXED'\nFRAME_1999999_CLASS = 2\nFRAME_1999999_CLASS_ID = 20999999\n"
        "FRAME_1999999_CENTER = 20999999\n\\begintext\n"
    )
    place = DskPlace(body="EGG", frame="EGG_FIXED", kernels=(frame,))
    assert write_dsk(tmp_path / "egg.bds", *egg, place=place, single_valued=True) == (20999999, "EGG_FIXED")


@pytest.mark.parametrize(
    ("place", "says"),
    [
        (DskPlace(body="egg"), "knows no body 'egg'"),
        (DskPlace(body=20999999), "knows no frame fixed to body 20999999"),
        (DskPlace(body="bennu", frame="EGG_FIXED"), "knows no frame 'EGG_FIXED'"),
    ],
)
def test_what_spice_does_not_know_is_told(tmp_path, egg, place, says):
    with pytest.raises(InputError, match=says):
        write_dsk(tmp_path / "egg.bds", *egg, place=place, single_valued=True)
    assert list(tmp_path.iterdir()) == []


def test_spice_that_does_not_end_is_ended(tmp_path, monkeypatch):
    triangle = np.eye(3), np.array([[0, 1, 2]])
    begun = []

    class Hanging(Child):
        def __init__(self, _script):
            sleeps = [sys.executable, "-S", "-c", "import time; time.sleep(1000)"]
            self.process = subprocess.Popen(sleeps, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
            begun.append(self.process)

    monkeypatch.setattr(spice_dsk, "Child", Hanging)
    monkeypatch.setattr(spice_dsk, "_TIMEOUT_S", 0.1)
    with pytest.raises(InputError, match="SPICE had not written the kernel after 0 s; leave the DSK out"):
        write_dsk(tmp_path / "a.bds", *triangle, place=DskPlace(body="bennu"), single_valued=False)
    assert begun[0].poll() is not None
    assert list(tmp_path.iterdir()) == []
