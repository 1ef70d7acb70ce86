"""The faults that commands answer, as one table: `test_faults.py` tries each, and the reference shows them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np

from fault_place import (
    Change,
    both,
    colour_png,
    copy,
    cube_fits,
    cut,
    edit,
    exported_map,
    folder,
    frame,
    frames,
    gamma_png,
    geometry_alone,
    lock,
    noise,
    put,
    remove,
    saturated_png,
    scaled,
    table_fits,
)
from sites import HEADER, SIZE, picture

LINE, LIST, BOX = "line", "list", "box"
"""How a message looks: one line; a line and one more for each file; the box of the parser of options."""

NOTHING: tuple[str, ...] = ()
BEGUN = ("map", "map/log", "map/run.json")
"""What is left by a run that ends before its first stage; the same command goes on there."""

TRIANGLE = """ply
format ascii 1.0
element vertex 3
property float x
property float y
property float z
element face 1
property list uchar int vertex_indices
end_header
0 0 0
1 0 0
0 1 0
3 0 1 2
"""
"""A mesh of one face."""


@dataclass(frozen=True, kw_only=True)
class Fault:
    """One fault, and how the command that meets it ends."""

    kind: str
    name: str
    command: str
    """As typed after `phomo`, in the folder that `fault_place.build_place` makes."""
    says: str
    """The end of standard error, after "phomo: "; " ... " stands for any words."""
    make: Change | None = None
    """Spoils something; None where the command itself is wrong."""
    code: int = 2
    left: tuple[str, ...] = NOTHING
    """Paths that the command makes or changes; "a/..." for a and all below."""
    form: str = LINE
    whole: bool = False
    """Whether `says` is the message to its end; else more words may follow."""
    disk: int | None = None
    """Bytes that a file may have; None for as many as there are."""
    test: str = ""
    """The test of a fault that needs a process of its own, or minutes: file::function. Empty for those tried here."""

    def is_said_by(self, words: str) -> bool:
        """Whether a message, in one line and without "phomo: ", begins as `says` does and has its parts in order; and
        where that is the whole message, whether it ends with the last part."""
        start, *parts = (" ".join(part.split()) for part in self.says.split("..."))
        if not words.startswith(start):
            return False
        at = len(start)
        for part in parts:
            found = words.find(part, at)
            if found < 0:
                return False
            at = found + len(part)
        return not self.whole or (words.endswith(parts[-1]) if parts else at == len(words))


RUN = "run site/site.toml --out map"
BODY = "body site/site.toml"
POSES = "view,x_m,y_m,z_m,sun_x,sun_y,sun_z,focal_px,width_px,height_px"
MAPPED = "run mapped/site.toml --out mapped/run"
RENDER = "render mapped/run --out a.png"
FIGURE = "figure mapped/run --out a.pdf"
EVALUATE = "evaluate mapped/run"
EXPORT = "export mapped/run --out out"
REFINE = "refine model --out out"
VIEWS = "views priors --radii-m 250 --at"
ONE = "site/images/1.fits"
PHOTO = "photos/20190301T101500.png"
INGEST = f"ingest {PHOTO} --out out"
ALL = "ingest photos/20190301T101500.png photos/20190302T101500.png photos/20190303T101500.png --out out"
SUNS = "--suns photos/suns.csv --pinhole 500 500 30 20"

Row = Callable[..., Fault]


def rows(kind: str, **given: object) -> Row:
    """A row of a kind, of name, command, words and change."""

    def row(name: str, command: str, says: str, make: Change | None = None, **more: object) -> Fault:
        return Fault(kind=kind, name=name, command=command, says=says, make=make, **(given | more))  # type: ignore[arg-type]

    return row


def image(name: str, make: Change, says: str, **more: object) -> Fault:
    """A fault of an image of the small site."""
    return rows("images", left=BEGUN)(name, str(more.pop("command", RUN)), says, make, **more)


def toml(kind: str, name: str, old: str, new: str, *says: str, **more: object) -> Fault:
    """A text of site.toml, replaced where it first occurs. says: parts of the message, from the place on."""
    return rows(kind)(name, RUN, f"site/site.toml: {' ... '.join(says)}", edit("site/site.toml", old, new), **more)


def images() -> Iterator[Fault]:
    again, linear = "fetch or export it again", "whose numbers are not linear in radiance"
    short = "before the end of the header or of the pixels that it announces; " + again
    yield image(
        "an image is missing",
        remove(ONE),
        f"site/site.toml: 1 of 4 images do not exist: {ONE}; image paths are relative to this file",
        left=NOTHING,
    )
    yield image(
        "two images are missing",
        remove(ONE, "site/images/3.fits"),
        f"site/site.toml: 2 of 4 images do not exist: {ONE}, site/images/3.fits; image paths are relative to this file",
        left=NOTHING,
    )
    yield image(
        "an image is a folder",
        both(remove(ONE), folder(ONE)),
        f"{ONE}: cannot be read: Is a directory; check the path",
        left=NOTHING,
    )
    yield image("an image is empty", put(ONE, b""), f"{ONE}: is an empty file; {again}")
    yield image("an image is a GIF", put(ONE, b"GIF89a...."), f"{ONE}: is not a FITS, PNG or TIFF image ... convert it")
    yield image(
        "an image is a JPEG",
        put(ONE, b"\xff\xd8\xff\xe0rest"),
        f"{ONE}: is a JPEG, {linear}; get the image as FITS or PNG",
    )
    yield image(
        "an image is a BigTIFF", put(ONE, b"II+\0...."), f"{ONE}: is a BigTIFF; convert it to plain TIFF or FITS"
    )
    yield image("a FITS file is cut short", cut(ONE, 5000), f"{ONE}: was cut short: it ends after 5000 bytes, {short}")
    yield image(
        "a FITS header is cut short",
        put(ONE, b"SIMPLE  =  T"),
        f"{ONE}: was cut short: it ends after 12 bytes, {short}",
    )
    yield image(
        "a PNG is cut short",
        put(ONE, b"\x89PNG\r\n\x1a\n"),
        f"{ONE}: is damaged (the PNG ends after 8 bytes, before its end mark); {again}",
    )
    yield image(
        "a TIFF is damaged",
        put(ONE, b"II*\0\xff\xff\xff\xff"),
        f"{ONE}: is damaged (the TIFF directory points past the end of the file); {again}",
    )
    yield image(
        "a FITS file holds a cube",
        cube_fits,
        f"{ONE}: has no image with two axes (found: (3, 4, 5)); extract one plane",
    )
    yield image(
        "a FITS file holds a table alone",
        table_fits,
        f"{ONE}: is a FITS file without an image, such as one of tables alone; give the file of the image",
        whole=True,
    )
    yield image("an image is in colour", colour_png, f"{ONE}: is a colour image; export one band as grey, linear")
    yield image(
        "a PNG declares a gamma",
        gamma_png,
        f"{ONE}: declares that its numbers are not linear in radiance (gamma 0.4546); export it again from linear data,"
        " or write linear = true in site.toml",
    )
    yield image(
        "an image has another size than its camera",
        frame(1, picture(1)[:60]),
        f"{ONE}: is 64 x 60 pixels, but its camera in site.toml is 64 x 64; correct the camera or the image",
    )
    left_out = "site/site.toml: region: reference: 'images/1.fits' is left out: it"
    for name, make, why in (
        ("NaN all over", frame(1, np.full((SIZE, SIZE), np.nan)), "has no valid pixel (all NaN"),
        ("saturated all over", saturated_png, "has no valid pixel (all NaN"),
        ("dark", frame(1, noise(0.0, 1e-4)), "is dark: nothing rises"),
        ("constant", frame(1, np.full((SIZE, SIZE), 0.4)), "is constant:"),
        ("noise", frame(1, noise(0.2, 0.01)), "is noise alone:"),
    ):
        yield image(f"an image is {name}", make, f"{left_out} {why} ... remove this view, or ... or name another view")
    yield image(
        "too many images are NaN all over",
        frames(lambda x: np.full_like(x, np.nan), (0, 3)),
        "site/site.toml: 2 of 4 images cannot be used, 3 must remain: images/0.fits: it has no valid pixel ... remove",
    )
    yield image(
        "two images are the same",
        copy("site/images/0.fits", ONE),
        "site/site.toml: images/0.fits and images/1.fits are the same image (all pixels equal); remove one",
    )
    unit = 'site/site.toml: brightness: is "iof", but 4 of 4 images are'
    yield image("per cent are called I/F", frames(lambda x: 100 * x), f"{unit} above 1.5, ... divide per cent by 100")
    yield image(
        "counts are called I/F", frames(lambda x: np.round(3e5 * x)), f'{unit} above 1.5, ... write brightness = "dn"'
    )
    yield image(
        "radiance is called I/F", frames(lambda x: 1e-6 * x), f"{unit} dimmer than any sunlit ground ... convert it"
    )
    fewer = "site/site.toml: 2 of 4 images cannot be used, 3 must remain: images/0.fits: its"
    yield image("too many images are negative", frames(lambda x: -x, (0, 3)), f"{fewer} brightness is negative ... add")
    yield image(
        "too many images are overexposed",
        frames(lambda x: np.minimum(x, np.quantile(x, 0.6)), (0, 3)),
        f"{fewer} highest brightness, ... it is overexposed; give a shorter exposure",
    )
    yield image(
        "the reference image has impossible brightness",
        frames(lambda x: -x, (1,)),
        "site/site.toml: region: reference: 'images/1.fits' is left out: its brightness is negative ... "
        "; or name another view",
    )
    yield image(
        "the images have nothing in common",
        frames(lambda x: x),
        "0 of 4 views registered, at least 3 are needed ... Use images that overlap more",
        code=1,
        left=(*BEGUN, "map/stages/..."),
    )
    views = "views are to be mapped, but landmarks are to be"
    yield image(
        "there are fewer images than views of a landmark",
        frames(lambda x: x),
        f"site/site.toml: 4 {views} in 6 views at least; add views, or pass --densify.min-views 4 or "
        "--preset few-views",
        command="run site/site.toml --out map --densify.min-views 6",
        left=NOTHING,
    )
    yield image(
        "there are fewer images than views of a landmark once one is left out",
        frames(lambda x: -x, (0,)),
        f"site/site.toml: 3 {views} in 4 views at least; add views, or pass --densify.min-views 3 or "
        "--preset few-views",
        command="run site/site.toml --out map --densify.min-views 4",
        code=1,
    )


SUN = "sun = [0.6, 0.0, -0.8]"
CAMERA = 'model = "PINHOLE"\nwidth = 64\nheight = 64\nparams = [640.0, 640.0, 32.0, 32.0]'
FOLDED = 'model = "SIMPLE_RADIAL"\nwidth = 64\nheight = 64\nparams = [640.0, 32.0, 32.0, -900.0]'
FIRST = "views[0] (images/0.fits): "
UNIT = "give the unit vector from the body towards the Sun in the camera frame (x right, y down, z forward)"


def suns() -> Iterator[Fault]:
    row = partial(toml, "Suns")
    numbers = f"{FIRST}sun: expected a list of 3 finite numbers, found"
    yield row("a Sun is missing", SUN, "", f"{FIRST}sun: is missing; {UNIT}")
    yield row("the key of a Sun is misspelt", SUN, SUN.replace("sun", "snu"), f"{FIRST}sun", "did you mean 'sun'?")
    yield row("a Sun is zero", SUN, "sun = [0, 0, 0]", f"{FIRST}sun: is the zero vector; {UNIT}")
    yield row("a Sun is no unit vector", SUN, "sun = [3, 0, -4]", f"{FIRST}sun", "has length 5, not 1; " + UNIT)
    yield row(
        "a Sun is nearly a unit vector",
        SUN,
        "sun = [0.6, 0, -0.81]",
        f"{FIRST}sun",
        "has length 1.00802, not 1; " + UNIT,
    )
    yield row("a Sun is NaN", SUN, "sun = [0.6, nan, -0.8]", f"{numbers} [0.6, nan, -0.8]; {UNIT}")
    yield row("a Sun has two numbers", SUN, "sun = [0.6, -0.8]", f"{numbers} [0.6, -0.8]; {UNIT}")
    yield row("a Sun is text", SUN, 'sun = "up"', f"{numbers} 'up'; {UNIT}")
    yield row("a Sun is of booleans", SUN, "sun = [true, false, false]", f"{numbers} [True, False, False]")
    yield row(
        "the sigma of a Sun is zero",
        SUN,
        SUN + "\nsun_sigma_deg = 0",
        f"{FIRST}sun_sigma_deg: expected a positive number, found 0",
    )
    yield row(
        "the sigma that all Suns share is negative",
        'name = "small"',
        'name = "small"\nsun_common_sigma_deg = -1',
        "sun_common_sigma_deg: expected a number of 0 or more, found -1",
    )
    yield rows("Suns", code=3)(
        "most Suns contradict the images",
        RUN,
        "the map is written, but not to be trusted: the Sun directions",
        left=("the whole map",),
        test="test_warnings.py::test_a_run_that_warns_says_so_at_its_end_and_in_its_files",
    )
    yield rows("Suns", code=1)(
        "wrong Suns lose the landmarks in relighting",
        RUN,
        "0 of the 1024 landmarks of the map are found again ... the Sun directions are most likely wrong: check",
        left=("finished stages",),
        test="test_relighting.py::test_landmarks_that_wrong_suns_lose_are_told_with_the_suns",
    )
    yield rows("Suns")(
        "most Suns light none of the bright ground",
        RUN,
        "images/000.fits: the Sun direction lights 0 % of the ground that is bright in the image, and so in 6 of 6",
        left=("finished stages",),
        test="test_inconsistent_views.py::test_reversed_suns_of_all_views_are_refused_with_the_convention",
    )
    yield rows("Suns")(
        "the Suns light no landmark, and views are not checked",
        f"{RUN} --no-check-views",
        "no observation is lit: the Suns contradict the poses and the surface; check `sun` of all views in site.toml",
        left=("finished stages",),
        test="test_faults.py::test_suns_that_light_no_landmark_are_told",
    )


PRIOR = "cam_from_body = {{ rotation_wxyz = {}, translation = [0, 0, 9], sigma_deg = 0.1, sigma = 1 }}"
POSE = f"{FIRST}cam_from_body: rotation_wxyz:"
SIZED, PARAMS, REFERENCE = "[40, 20]", "[640.0, 640.0, 32.0, 32.0]", 'reference = "images/1.fits"'


def keys() -> Iterator[Fault]:
    row = partial(toml, "TOML")
    whole, stride = "expected a positive whole number, found", "region: stride"
    yield row("an unknown key of a view", SUN, SUN + "\nsun_sigma = 1", f"{FIRST}sun_sigma: unknown", "'sun_sigma_deg'")
    yield row("an unknown key", "body =", "bodi =", "bodi: unknown key; did you mean 'body'?")
    yield row("an unknown table", "[region]", "[regoin]", "regoin: unknown key; did you mean 'region'?")
    yield row("a misspelt key of the camera", "width", "widht", "camera: width", "'widht'; did you mean 'width'?")
    yield row("a misspelt key of the region", "center_px", "centre_px", "region: centre_px: unknown", "'center_px'?")
    yield row("no name", 'name = "small"', "", "name: is missing; give text in quotes", whole=True)
    yield row("an unknown body", '"vesta"', '"tatooine"', "body: 'tatooine' is not known", "bennu", "body_radius_m")
    yield row("a radius of zero", '"vesta"', '"tatooine"\nbody_radius_m = 0', "body_radius_m: expected a positive")
    yield row("a wrong kind of brightness", '"iof"', '"radiance"', "brightness: 'radiance'", "'iof', 'dn'")
    yield row(
        "no kind of brightness", 'brightness = "iof"', "", "brightness: is missing; give 'iof' or 'dn'", whole=True
    )
    yield row("no camera", "[camera]", "[cam]", "camera", "[camera] or one [cameras.NAME]")
    yield row("the camera of a view is unknown", SUN, SUN + '\ncamera = "wide"', f"{FIRST}camera", "no [cameras.wide]")
    yield row("a fisheye camera", "PINHOLE", "OPENCV_FISHEYE", "camera: model", "'OPENCV_FISHEYE'", "undistort the")
    yield row("a distortion that folds the image", CAMERA, FOLDED, "camera: params", "folds", "f, cx, cy, k1")
    yield row("a gamma of no image", PARAMS, PARAMS + "\ngamma = 22", "camera: gamma: 22 is no", "1.8 to 2.6")
    yield row("three numbers of a camera", PARAMS, "[640.0, 32, 32]", "camera: params: expected", "4 finite numbers")
    yield row(
        "a negative focal length",
        "[640.0, 640.0,",
        "[-640, 640,",
        "camera: params: the focal length is -640; give pixels above 0",
        whole=True,
    )
    yield row(
        "focal lengths and centre swapped",
        PARAMS,
        "[32, 32, 640, 1e6]",
        "camera: params",
        "far outside",
        "fx, fy, cx, cy",
    )
    yield row(
        "a negative border", PARAMS, f"{PARAMS}\nborder_px = [0, 0, 0, -1]", "camera: border_px: expected", "0 or more"
    )
    yield row("a number too large", "[640.0,", f"[{10**400},", "camera: params", "4 finite numbers")
    yield row("an image without width", "width = 64", "width = 0", f"camera: width: {whole} 0")
    yield row("half a pixel of width", "width = 64", "width = 64.5", f"camera: width: {whole} 64.5")
    yield row(
        "the reference is no view", REFERENCE, 'reference = "images/1.fit"', "region: reference", "'images/1.fits'?"
    )
    yield row("a centre without reference", REFERENCE, "", "region: center_px", "give `reference`, too")
    yield row(
        "the region is beside the image", "[30.0, 32.0]", "[10, 32]", "region: center_px", "outside images/1.fits"
    )
    yield row("the region is larger than the image", SIZED, "[40, 66]", "region: center_px", "y -1 to 65", "shrink")
    yield row("a region without height", SIZED, "[40, 0]", "region: size_px", "positive whole numbers")
    yield row("a stride of zero", SIZED, f"{SIZED}\nstride = 0", f"{stride}: {whole} 0")
    yield row("a negative stride", SIZED, f"{SIZED}\nstride = -2", f"{stride}: {whole} -2")
    yield row("half a stride", SIZED, f"{SIZED}\nstride = 1.5", f"{stride}: {whole} 1.5")
    yield row("two strides", SIZED, f"{SIZED}\nstride = [2, 2]", f"{stride}: {whole} [2, 2]")
    yield row("a stride of the region's height", SIZED, f"{SIZED}\nstride = 20", stride, "single row", "smaller stride")
    yield row("an image twice", "images/2.fits", "images/../images/0.fits", "views", "same file", "remove")
    yield row("an image is a number", '"images/0.fits"', "7", "views[0]: image", "text in quotes", "7")
    yield row("an image without name", '"images/0.fits"', '" "', "views[0]: image", "is empty")
    yield row(
        "a prior's rotation is no unit", SUN, f"{SUN}\n{PRIOR.format('[1, 1, 0, 0]')}", f"{POSE} has length 1.41421"
    )
    yield row("a prior's rotation is short", SUN, f"{SUN}\n{PRIOR.format('[1, 0, 0]')}", f"{POSE} expected", "4 finite")
    yield row("a table in place of a list", "[[views]]\nimage", "[views]\nimage", "is not valid TOML")
    yield row("a quote is missing", 'name = "small"', 'name = "small', "is not valid TOML", "line 1")
    yield row("linear is text", '"iof"', '"iof"\nlinear = "yes"', "linear: expected true or false, found 'yes'")
    file = rows("TOML")
    none = put("site/site.toml", HEADER.split("[region]")[0])
    yield file("no view", RUN, "site/site.toml: views: there are 0, at least 3 are needed; add [[views]]", none)
    yield file("site.toml is missing", "run none.toml --out map", "none.toml: there is no such file; give a site.toml")
    yield file("site.toml is an image", f"run {ONE} --out map", f"{ONE}: is not UTF-8 text ... give a site.toml")
    yield file(
        "the folder has no site.toml",
        "run photos --out map",
        "photos: the folder holds no site.toml; give a site.toml, or the folder with one",
    )


CONTROL = "point,view,x_px,y_px,x_m,y_m,z_m,sigma_m\n"
SHOTS = "track,x_m,y_m,z_m,sigma_m,track_sigma_m\n"


def options() -> Iterator[Fault]:
    row = rows("options")
    number = "give a whole number, 1 to"
    yield row("no iterations", f"{RUN} --adjust.max-reweightings 0", f"--adjust.max-reweightings is 0; {number} 100")
    yield row("negative features", f"{RUN} --sfm.max-features -5", f"--sfm.max-features is -5; {number}")
    yield row("no threads", f"{RUN} --sfm.threads 0", f"--sfm.threads is 0; {number} 1024, or -1")
    yield row(
        "NaN", f"{RUN} --adjust.smooth-sigma-rad nan", "--adjust.smooth-sigma-rad is nan; give 0 or more", whole=True
    )
    yield row("infinity", f"{RUN} --flow.smoothness inf", "--flow.smoothness is inf; give 0 or more")
    yield row("no steps", f"{RUN} --adjust.solver.max-steps 0", f"--adjust.solver.max-steps is 0; {number} 100000")
    yield row("a stride of zero", f"{RUN} --region.stride 0", f"--region.stride is 0; {number} 65535")
    yield row(
        "of a study's runs", "study --out out --run.sfm.threads 0", f"--run.sfm.threads is 0; {number} 1024, or -1"
    )
    few = "--adjust.max-reweightings"
    yield row("of a refinement", f"{REFINE} {few} 0", f"{few} is 0; {number} 100")
    yield row(
        "of a simulation",
        "simulate --out out --detector.bits 99",
        "--detector.bits is 99; give a whole number, 8 to 16",
    )
    yield row(
        "lighting of a whole body",
        "simulate --preset bilobed --lighting harsh --out out",
        "--lighting and --max-emission-deg are of places; stations see a whole body as it spins",
    )
    yield row("of an ingestion", f"{INGEST} --position-sigma nan", "--position-sigma is nan; give above 0")
    yield row("workers of a body", f"{BODY} --workers 0", "--workers is 0; give a whole number, 1 or more")
    yield row("parts of a body", f"{BODY} --plan-only --tile 3", "--plan-only, --print-tasks and --tile do one part")
    yield row("tiles of a body", f"{BODY} --plan.tile-px 8", "--plan.tile-px is 8; give a whole number, 32 to 4096")
    yield row(
        "views of a body held out",
        f"{BODY} --run.hold-out images/1.fits",
        "--run.hold-out, --run.control and --run.altimetry are of a place",
    )
    yield row("of an export", f"{EXPORT} --unit-m 0", "--unit-m is 0; give above 0")
    yield row("of a plan", "plan priors --slope-deg 90", "--slope-deg is 90; give above 0, up to 35")
    yield row(
        "of a choice of views",
        f"{VIEWS} 10 5 --max-emission-deg 120",
        "--max-emission-deg is 120; give above 0, up to 90",
    )
    yield row(
        "a focal length of zero",
        f"{INGEST} --pinhole 0 500 30 20",
        "--pinhole is (0.0, 500.0, 30.0, 20.0): 0; give above 0",
    )
    yield row("an unknown matcher", f"{RUN} --matcher roam", "no matcher 'roam'; known: relight, flow, roma")
    yield row(
        "RoMa without weights", f"{RUN} --matcher roma", "the matcher roma needs --roma.weights FILE; ... fetch it"
    )
    held = "--hold-out (hold_out=):"
    yield row(
        "a view held out is none",
        f"{RUN} --hold-out 9.fits",
        f"{held} no view '9.fits' in the site; nearest: images/3.fits",
    )
    yield row(
        "the reference is held out",
        f"{RUN} --hold-out images/1.fits",
        f"{held} images/1.fits is the site's reference view; hold out others",
    )
    yield row(
        "too many views are held out",
        f"{RUN} --hold-out images/0.fits images/2.fits",
        f"{held} 2 of 4 views are held out, at least 3 must remain to be mapped; hold out fewer",
    )
    yield row(
        "a model without coefficients of the body",
        f"{RUN} --reflectance lunar-lambert",
        "no published lunar-lambert coefficients for body 'eros' (known: ceres, vesta); use reflectance akimov",
        edit("site/site.toml", '"vesta"', '"eros"'),
    )
    table = f"{RUN} --control gcp.csv"
    yield row("no table of control points", table, "gcp.csv: there is no such table of control points; check the path")
    yield row(
        "an empty table of control points",
        table,
        "gcp.csv: the first line has no column 'point'; write point,view,",
        put("gcp.csv", ""),
    )
    yield row(
        "a table without points",
        table,
        "gcp.csv: has no control point; write a line for each measured pixel",
        put("gcp.csv", CONTROL),
    )
    yield row(
        "a control point in an unknown view",
        table,
        "gcp.csv, line 2: point 'a' is in view '9.fits', which the site does not have; write the image's path as "
        "site.toml does (the first is 'images/0.fits')",
        put("gcp.csv", CONTROL + "a,9.fits,1,1,0,0,0,1\n"),
    )
    yield row(
        "a control point at NaN",
        table,
        "gcp.csv, line 2: y_px is 'nan', expected a number",
        put("gcp.csv", CONTROL + "a,images/0.fits,1,nan,0,0,0,1\n"),
    )
    shots = f"{RUN} --altimetry shots.csv"
    yield row("no table of altimetry", shots, "shots.csv: there is no such table of altimetry; check the path")
    yield row(
        "a table of altimetry without shots",
        shots,
        "shots.csv: has no shot; write a line for each",
        put("shots.csv", SHOTS),
    )
    yield row(
        "a shot at NaN",
        shots,
        "shots.csv, line 2: z_m is 'nan', expected a number",
        put("shots.csv", SHOTS + "a,0,0,nan,1,5\n"),
    )
    yield row(
        "altimetry of a site without pose priors",
        shots,
        "shots.csv: shots need a map that is roughly in place, and the site has no pose priors; add cam_from_body",
        put("shots.csv", SHOTS + "a,0,0,0,1,5\n"),
    )
    yield row("a misspelt command", "rnu site/site.toml", "there is no command 'rnu'; did you mean `phomo run`?")
    yield row(
        "a command unlike any", "zzz", "there is no command 'zzz'; commands: ingest, calibrate, views, plan, simulate"
    )
    typed = rows("options", form=BOX)
    one_of, expected = "Invalid choice ... invalid choice", "Expected one of ("
    yield typed(
        "an unknown layer",
        f"{FIGURE} --layers colour",
        f"{one_of} 'colour' for argument '--layers'. {expected}'albedo', 'relief', 'height'",
    )
    yield row("a resolution of a figure", f"{FIGURE} --dpi 5", "--dpi is 5; give 50 to 2400")
    meant = "Unrecognized options: {} ... Perhaps you meant: ... {} ... run phomo run --help"
    yield typed(
        "a misspelt option",
        f"{RUN} --sfm.max-feature 5",
        f"Unrecognized options ... {meant.format('--sfm.max-feature, 5', '--sfm.max-features INT SIFT keypoints')}",
    )
    yield typed(
        "a misspelt option of the command",
        "run site --oout b",
        f"Unrecognized options ... {meant.format('--oout, b', '--out {None}|PATH Folder for the run')}",
    )
    yield typed(
        "an option of another command",
        "info site --out b",
        "Unrecognized options ... Unrecognized options: --out, b ... run phomo info --help",
    )
    yield typed(
        "a misspelt preset",
        f"{RUN} --preset quik",
        f"{one_of} 'quik' for argument '--preset'. {expected} ... 'quick'",
    )
    yield typed(
        "an unknown model",
        f"{RUN} --reflectance lambert",
        f"{one_of} 'lambert' for argument '--reflectance'. {expected} ... 'lunar-lambert'",
    )
    yield typed(
        "an unknown format",
        f"{EXPORT} --products dem",
        f"{one_of} 'dem' for argument '--products'. {expected}'dtm', 'albedo'",
    )
    yield typed(
        "text for a number",
        f"{RUN} --adjust.max-reweightings many",
        "Value error ... Error parsing --adjust.max-reweightings: ... 'many' ... Range: 1 to 100. ... phomo run --help",
    )
    missing = "Missing argument ... Missing value for argument"
    yield typed(
        "an option without value",
        f"{RUN} --adjust.max-reweightings",
        f"{missing} '--adjust.max-reweightings'. Expected 1 values. ... run phomo run --help",
    )
    yield typed(
        "one number of two",
        "views priors --at 10",
        f"{missing} '--at'. Expected 2 values. ... run phomo views --help",
    )
    required = "Required options ... Missing from phomo"
    yield typed(
        "a required option is missing", "export mapped/run", f"{required} export: --out PATH Folder for the products"
    )
    yield typed("no site", "run", f"{required} run: PATH site.toml, which names the images ... run: phomo run --help")
    yield typed(
        "no command",
        "",
        "Missing subcommand ... Expected one of {ingest, calibrate, views, plan, ... }. ... run phomo --help",
    )


def folders() -> Iterator[Fault]:
    row = rows("folders")
    foreign = "exists and is not a run folder; choose another --out"
    yield row(
        "the output of a calibration exists",
        "calibrate site --out site/site.toml",
        "site/site.toml: exists; choose another --out, or remove it",
        whole=True,
    )
    yield row(
        "the output is a file",
        "run site --out site/site.toml",
        f"site/site.toml: {foreign}",
        whole=True,
    )
    yield row("the output is the site", "run site --out site", f"site: {foreign}", whole=True)
    yield row(
        "the output is below a file",
        "run site --out site/site.toml/map",
        "site/site.toml/map/run.json: cannot be written: Not a directory; part of the path is a file",
    )
    yield row(
        "a name too long",
        f"run site --out {300 * 'x'}",
        f"{60 * 'x'}... (309 characters): File name too long; choose a shorter path",
        whole=True,
    )
    another = "run site --out mapped/run"
    yield row(
        "the map of another site",
        another,
        "mapped/run: belongs to the site 'place' ... this is the site 'small' ... choose another --out, or give",
    )
    yield row(
        "files that no run wrote",
        f"{another} --overwrite",
        "mapped/run: holds thesis.tex, which no run wrote; move it, or choose another --out",
        put("mapped/run/thesis.tex", "x"),
    )
    yield row(
        "the map of an unknown site",
        another,
        "mapped/run: holds a map, and not of which site; this is the site 'small' ... choose another --out",
        edit("mapped/run/run.json", '"owner"', '"was"'),
    )
    yield row(
        "the map of a model",
        f"{REFINE.replace('out out', 'out mapped/run')} --min-observations 1 --min-view-observations 1",
        "mapped/run: belongs to the site 'place' ... this is the model 'model' ... choose another --out",
    )
    yield row(
        "a run folder of another version",
        another,
        "mapped/run: run folder format 9, made by version 9; this version ... choose another --out, or remove",
        put("mapped/run/run.json", '{"format": 9, "version": "9"}'),
    )
    yield row(
        "run.json is damaged",
        MAPPED,
        "mapped/run/run.json: damaged ... choose another --out, or remove the folder",
        put("mapped/run/run.json", "{"),
    )
    yield row(
        "a folder in the log's place",
        MAPPED,
        "mapped/run/log: cannot be written: Is a directory; a folder of this name is in the way; move it",
        folder("mapped/run/log"),
    )
    writing = "has been writing to this folder since 2026-01-02T03:04:05Z; wait for it"
    yield row("another run is at work", MAPPED, f"mapped/run: process ... {writing}, stop it", lock())
    yield row("another run, and --overwrite", f"{another} --overwrite", f"mapped/run: process ... {writing}", lock())
    yield row(
        "a run on another computer",
        MAPPED,
        f"mapped/run: process ... on elsewhere {writing} ... if it no longer runs there, remove mapped/run/lock",
        lock(host="elsewhere"),
    )
    yield row(
        "a lock that is being written",
        MAPPED,
        "mapped/run/lock: is just being written by another run; try again in 10 s",
        put("mapped/run/lock", ""),
    )
    yield row(
        "a site is simulated among files",
        "simulate --out site",
        "site: is not empty and holds no simulated site; choose another folder",
    )
    yield row(
        "a site is simulated on a file",
        f"simulate --out {PHOTO}",
        f"{PHOTO}: is a file; choose a folder for the simulated site",
    )
    yield row(
        "a site is simulated again",
        "simulate --out site",
        "site: holds a simulated site already; pass --overwrite, or choose another folder",
        put("site/simulation.toml", ""),
    )
    yield row("images are ingested among files", f"ingest {PHOTO} --out site", "site: exists and is not empty; choose")
    yield row(
        "a map is exported among files",
        "export mapped/run --out photos --products csv",
        "photos: holds 20190301T101500.png, which no earlier export wrote; choose another --out",
        whole=True,
    )
    yield row(
        "a map is exported over another one",
        "export mapped/run --out out --products csv",
        "out: holds an export of the map 'other' (4 images); this is the map 'bumps' (4 images): choose another --out, "
        "or give --overwrite (overwrite=True) to replace it",
        exported_map("out"),
    )
    yield row(
        "a picture is rendered over an image of the site",
        "render mapped/run --out mapped/images/000.fits",
        "mapped/images/000.fits: exists; choose another --out, or give --overwrite",
    )
    yield row(
        "a figure is drawn over another file",
        FIGURE,
        "a.pdf: exists; choose another --out, or give --overwrite",
        put("a.pdf", "x"),
    )
    yield row(
        "a map is exported to a file",
        f"export mapped/run --out {PHOTO} --products csv",
        f"{PHOTO}: is a file, not a folder; choose another --out",
    )
    yield row("a body among files", f"{BODY} --out photos", f"photos: {foreign}", whole=True)
    yield row(
        "a body in the folder of a run",
        f"{BODY} --out mapped/run",
        "mapped/run: belongs to the site 'place' ... this is the body 'small' "
        "... : choose another --out, or give --overwrite",
    )
    yield row(
        "a tile of a body without a plan", f"{BODY} --tile 0", "site/body: no plan was made there; run the command"
    )
    yield row("a study among files", "study --out photos", "photos: exists and is not a study; choose another folder")
    yield row(
        "an evaluation below a file",
        f"{EVALUATE} --no-images --out {PHOTO}",
        f"{PHOTO}/evaluation.json: cannot be written: File exists; part of the path is a file",
    )
    yield row(
        "a folder in a picture's place",
        RENDER,
        "a.png: cannot be written: Is a directory; a folder of this name is in the way",
        folder("a.png"),
    )
    yield row("a chosen site exists", f"{VIEWS} 10 5 --out priors", "priors/site.toml: exists; choose another --out")


def others() -> Iterator[Fault]:
    row = rows("other commands")
    finished = "give a folder that `phomo run` has finished"
    run_again = "run the site again"
    scene, metrics, config = (f"mapped/run/{name}" for name in ("scene.h5", "metrics.json", "config.toml"))
    yield row(
        "info of nothing", "info none", "none: no such file or folder; give a site.toml or the folder of a finished"
    )
    yield row(
        "info of another folder", "info photos", "photos: the folder holds none of site.toml, scene.h5 and body.ply"
    )
    yield row(
        "metrics.json is damaged",
        "info mapped/run",
        f"{metrics}: is damaged (...); {run_again}",
        put(metrics, "{"),
        whole=True,
    )
    yield row(
        "a count in metrics.json is too large for a float",
        "info mapped/run",
        f"{metrics}: is damaged (it holds no figures of a run); {run_again}",
        put(metrics, '{"metrics": {"views": 1' + 400 * "0" + "}}"),
    )
    yield row(
        "metrics.json is a list", "info mapped/run", f"{metrics}: is damaged (...); {run_again}", put(metrics, "[1]")
    )
    damaged = f"{scene}: is not a scene file, or is damaged"
    yield row("scene.h5 is text", "info mapped/run", f"{damaged} (it is no HDF5 file); {run_again}", put(scene, "x"))
    yield row(
        "scene.h5 is cut short",
        "info mapped/run",
        f"{damaged} (it ends after 5000 of ... bytes); {run_again}",
        cut(scene, 5000),
        whole=True,
    )
    yield row("a folder without a map", "evaluate photos", f"photos: the folder holds no scene.h5; {finished}")
    yield row("a folder without a map to view", "view photos", f"photos: the folder holds no scene.h5; {finished}")
    yield row("rivals of a folder without a map", "rivals photos", f"photos: the folder holds no scene.h5; {finished}")
    yield row(
        "a view to predict that there is not",
        "rivals mapped/run --hold-out none.fits",
        "--hold-out (predict=): none.fits: there is no such view, so that it cannot be predicted; the run held out none"
        ": run the site again with --hold-out",
    )
    yield row("a folder that is not there", "evaluate none", f"none: no such folder; {finished}")
    yield row(
        "no truth", f"{EVALUATE} --truth none.h5", "none.h5: there is no such truth file; `phomo simulate` writes one"
    )
    yield row(
        "the truth of another site",
        f"{EVALUATE} --truth other/truth.h5",
        "other/truth.h5: is the truth of another site: its Suns by ... give the truth.h5 that lies beside",
        test="test_same_site.py::test_evaluate_refuses_the_truth_of_another_site",
    )
    yield row(
        "the truth of another body",
        "evaluate site/body --truth other/truth.h5",
        "other/truth.h5: is the truth of another site: the relative rotations of its cameras by ... give the truth.h5",
        test="test_same_site.py::test_evaluate_refuses_the_truth_of_another_body",
    )
    yield row("a map for a truth", f"{EVALUATE} --truth {scene}", f"{scene}: is an HDF5 file, but not the truth of")
    yield row(
        "truth and reference",
        f"{EVALUATE} --truth a.h5 --reference b.ply",
        "truth and reference are both given; compare with one at a time",
    )
    yield row(
        "poses without a map",
        f"{EVALUATE} --cameras mapped",
        "cameras align a map with another one: give the reference",
    )
    yield row(
        "a reference of another kind", f"{EVALUATE} --reference {PHOTO}", f"{PHOTO}: is not a map to compare with; give"
    )
    yield row("no reference", f"{EVALUATE} --reference none.ply", "none.ply: there is no such file; check the path")
    yield row(
        "a damaged PLY file",
        f"{EVALUATE} --reference a.ply",
        "a.ply: is not a complete PLY file (it does not begin with a header ... export it again",
        put("a.ply", "ply\n"),
    )
    yield row(
        "a reference folder without map",
        f"{EVALUATE} --reference photos",
        "photos/scene.h5: there is no such file; run the site first, or check the path",
    )
    yield row(
        "a folder without poses",
        f"{EVALUATE} --reference mapped/run --cameras photos",
        "photos/cameras.bin: there is no",
    )
    give = "give the site.toml of the run's images (--site, site=), or leave the images out (--no-images, images=False)"
    yield row(
        "the site has moved",
        EVALUATE,
        f"gone.toml: the site of the run is not there (any more); {give}",
        put(config, 'site = "gone.toml"\n'),
    )
    yield row(
        "the run names no site", EVALUATE, f"mapped/run: config.toml does not name the site; {give}", put(config, "")
    )
    yield row(
        "the run's site is a number",
        EVALUATE,
        f"{config}: site: expected a path in quotes, found 7; {give}",
        put(config, "site = 7\n"),
    )
    yield row("config.toml is damaged", EVALUATE, f"{config}: is not valid TOML", put(config, "site ="))
    yield row(
        "the images of another site",
        f"{EVALUATE} --site site/site.toml",
        f"site/site.toml: has no view 'images/000.fits', which the run used; {give}",
        whole=True,
    )
    seen = [f"mapped/images/{k:03d}.fits" for k in range(4)]
    yield row(
        "the images of a run are in per cent by now",
        EVALUATE,
        'mapped/site.toml: brightness: is "iof", but 4 of 4 images are above 1.5, ... divide per cent by 100',
        scaled(100.0, *seen),
    )
    yield row(
        "an image of a run is in another unit by now",
        EVALUATE,
        "mapped/site.toml: images/001.fits: its ground has I/F ... the run used this view: give the images that",
        scaled(1000.0, seen[1]),
    )
    yield row(
        "a picture of another format", "render mapped/run --out a.jpg", "a.jpg: cannot write .jpg; use .fits or .png"
    )
    yield row("no such view", f"{RENDER} --view 7", "no view '7' in scene 'bumps'; nearest: images/00")
    yield row(
        "an azimuth alone", f"{RENDER} --sun-azimuth-deg 9", "the Sun's azimuth and elevation go together: give both"
    )
    sun = f"{RENDER} --sun-azimuth-deg 9 --sun-elevation-deg"
    yield row("a Sun below the ground", f"{sun} -5", "Sun's elevation -5.0 degrees: must be above 0 and at most 90")
    yield row("a Sun at NaN", f"{sun} nan", "Sun's elevation nan degrees: must be above 0 and at most 90")
    yield row(
        "an infinite azimuth",
        f"{RENDER} --sun-azimuth-deg inf --sun-elevation-deg 9",
        "Sun's azimuth inf degrees: must be a finite number",
        whole=True,
    )
    yield row("a Sun of zeros", f"{RENDER} --sun 0 0 0", "Sun [0.0, 0.0, 0.0] is not a direction; give three numbers")
    yield row(
        "two Suns", f"{sun} 9 --sun 0 0 1", "the Sun is given twice: give its direction, or azimuth and elevation"
    )
    yield row(
        "a rendering of geometry alone", RENDER, "scene 'bumps' holds geometry alone ... run again with", geometry_alone
    )
    yield row("a figure of another format", "figure mapped/run --out a.jpg", "a.jpg: cannot write .jpg; use .pdf")
    yield row("a figure of no run", "figure none --out a.pdf", f"none: no such folder; {finished}")
    yield row(
        "a figure of a folder without a map",
        "figure site --out a.pdf",
        f"site: the folder holds no scene.h5; {finished}",
    )
    yield row(
        "a layer of uncertainties that were not computed",
        f"{FIGURE} --layers height-sigma",
        "scene 'bumps' has no layer 'height-sigma': it states no uncertainty of the height",
    )
    yield row(
        "albedos of geometry alone",
        FIGURE,
        "scene 'bumps' has no layer 'albedo': it holds geometry alone (reflectance = none)",
        geometry_alone,
        whole=True,
    )
    yield row(
        "a profile beside the map",
        f"{FIGURE} --profile 0 0 5 0",
        "the profile from (0.0, 0.0) to (5.0, 0.0) misses the map",
    )
    yield row(
        "a profile of no length", f"{FIGURE} --profile 9 9 9 9", "profile from ...: give two different places as x"
    )
    yield row(
        "maps too narrow",
        f"{FIGURE} --width-mm 60 --across 3",
        "3 maps side by side are 7 mm wide each in a figure of 60 mm, 15 are the least",
    )
    yield row(
        "a figure higher than a page",
        f"{FIGURE} --across 1 --columns 2",
        "the figure would be ... mm high, a page has 240",
    )
    yield row("no view for a Sun's arrow", f"{FIGURE} --view 7", "no view '7' in scene 'bumps'; nearest: images/00")
    yield row("a figure below a file", f"figure mapped/run --out {PHOTO}/a.pdf", f"{PHOTO}/a.pdf: cannot be written")
    yield row("nothing to measure", "measure mapped/run", "nothing to measure; give two places (--line x y x y)")
    yield row("a place beside the map", "measure mapped/run --line 0 0 9 9", "there is no landmark at pixel (0, 0) of")
    yield row(
        "half a corner", "measure mapped/run --outline 1 2 3 4 5", "--outline has 5 numbers; give x and y of each"
    )
    yield row("lengths of no run", "measure none --line 0 0 9 9", f"none: no such folder; {finished}")
    fixed = "scene 'bumps' cannot be exported as"
    yield row(
        "SUMFILEs without a frame",
        f"{EXPORT} --products sumfile",
        f"{fixed} sumfile: it is in no body-fixed frame; give",
    )
    yield row("sigmas of a map without", f"{EXPORT} --products sigma", f"{fixed} sigma: it states no uncertainties")
    yield row(
        "albedo of geometry alone", f"{EXPORT} --products albedo", f"{fixed} albedo: it holds geometry", geometry_alone
    )
    yield row(
        "a frame that is not the body's",
        f"{EXPORT} --body-fixed --unit-m 60 --body vesta",
        "the landmarks of scene 'bumps' would be ... this is not the body-fixed frame, or the unit is wrong; check",
    )
    yield row(
        "a body-fixed frame without unit",
        f"{EXPORT} --body-fixed",
        "--body-fixed needs the scene's unit of length: give",
    )
    yield row(
        "pixels too fine",
        f"{EXPORT} --resolution 1e-6 --unit-m 60 --products dtm",
        "pixels of 1e-06 make a map of ... choose a coarser --resolution",
    )
    yield row(
        "no transform", f"{EXPORT} --transform t.toml", "t.toml: there is no such file; give a TOML file with scale"
    )
    yield row(
        "a transform of scale zero",
        f"{EXPORT} --transform t.toml",
        "t.toml: scale: expected a positive number, found 0",
        put("t.toml", "scale = 0\n"),
    )
    yield row(
        "a frame from a site without poses",
        f"{EXPORT} --site mapped/site.toml",
        "0 of the 4 views have a pose prior, at least 3 are needed ... add cam_from_body to more views of site.toml",
    )
    yield row("a density of a place", f"{EXPORT} --density-kg-m3 1190", "--density-kg-m3 is for a whole body (a folder")
    whole = "export body --out out"
    yield row(
        "a shape model cut short", whole, "body/body.ply: is not a complete PLY file", put("body/body.ply", "ply")
    )
    yield row(
        "a shape model with holes",
        whole,
        "body/body.ply: is not a closed mesh whose faces all look the same way; close its holes first",
        put("body/body.ply", TRIANGLE),
    )
    yield row("heights of a whole body", f"{whole} --products dtm", "dtm is a product of the map of a place",
              put("body/body.ply", TRIANGLE))  # fmt: skip
    yield row(
        "no model", "refine none --out out", "none/cameras.txt: there is no such file; give the folder of a model"
    )
    yield row(
        "a damaged model",
        REFINE,
        "model/points3D.txt, line 1: value 1 is 'x', expected a finite number",
        put("model/points3D.txt", "x y z\n"),
    )
    yield row(
        "a model without a body",
        f"{REFINE} --reflectance lunar-lambert",
        "no published lunar-lambert coefficients without a body (known: ceres, vesta); name the body, or use"
        " reflectance akimov or mcewen, which need none",
    )
    yield row(
        "landmarks with too few observations",
        f"{REFINE} --min-observations 99 --min-view-observations 1",
        "model: no landmark has enough lit observations; lower --shadow-threshold or --min-observations",
    )
    yield row(
        "a reference that the model lacks", f"{REFINE} --reference 7.fits", "model/images.txt: holds no image '7.fits'"
    )
    yield row(
        "views of a site without poses", "views site --at 10 5", "site/site.toml: none of its 4 views has a pose prior"
    )
    yield row(
        "a plan of a site without poses", "plan site", "site/site.toml: none of its 4 views has a pose (cam_from_body)"
    )
    yield row(
        "a plan of a place that nobody sees",
        "plan priors --radii-m 250 --at -170 5",
        "priors/site.toml: 0 of 3 views see the place, a map needs 3 ... beyond the limb",
    )
    yield row(
        "candidates that do not see the place",
        "plan priors --radii-m 250 --at 10 5 --candidates.table c.csv",
        "c.csv: none of the 1 candidates sees the place. far: the place lies beyond the limb",
        put("c.csv", f"{POSES}\nfar,-2000,0,0,-1,0,0,500,60,40\n"),
    )
    yield row("a latitude beyond the pole", f"{VIEWS} 10 95", "10 95 is not a longitude and a latitude: give degrees")
    yield row("a radius of zero for views", "views priors --at 10 5 --radii-m 0", "radii 0: give one of a sphere")
    yield row(
        "a place that nobody sees", f"{VIEWS} -170 5", "priors/site.toml: no view sees -170 5: from 3 it lies beyond"
    )
    yield row(
        "limits that leave no view",
        f"{VIEWS} 10 5 --gsd-m 5 6 --out new",
        "0 of the 3 views that see the place are within the limits, a map needs 3 at least (--gsd-m leaves out 3)",
    )
    yield row(
        "no camera and no Suns", ALL, "3 of 3 files cannot be used ... --camera NAME ... pass --kernels", form=LIST
    )
    yield row(
        "no Suns", f"{INGEST} --pinhole 500 500 30 20", f"{PHOTO}: the Sun's direction is unknown: pass --kernels"
    )
    yield row("no such file", "ingest none.img --out out", "none.img: there is no such file; check the path")
    yield row(
        "a file of no archive", "ingest site/site.toml --out out", "site/site.toml: is not a PDS3 or PDS4 label, ISIS"
    )
    yield row(
        "a page of the web in a label's place",
        "ingest a.img --out out",
        "a.img: a.lbl beside it is not a PDS3 or PDS4 label (it begins with ... fetch it again, or move it",
        both(put("a.img", bytes(100)), put("a.lbl", "<!DOCTYPE html>"), put("a.xml", "<!DOCTYPE html>")),
    )
    yield row(
        "an unknown camera", f"{INGEST} --camera kodak", "there is no camera 'kodak' in the table; known: dawn-fc1"
    )
    yield row(
        "no table of Suns", f"{INGEST} --suns none.csv", "none.csv: there is no such table of Suns; check the path"
    )
    yield row(
        "a table of Suns with a wrong Sun",
        f"{INGEST} {SUNS}",
        f"photos/suns.csv, line 2: the Sun has length 1.20416, not 1; {UNIT}",
        edit("photos/suns.csv", "0.6,", "0.9,"),
    )
    yield row(
        "a table of Suns that names files with their folders",
        f"{INGEST} {SUNS}",
        f"{PHOTO}: the Sun's direction is unknown: ... ; no row of photos/suns.csv has its name, without folders",
        edit("photos/suns.csv", "20190301T", "photos/20190301T"),
    )
    yield row(
        "a kernel that is none", f"{INGEST} --kernels a.tls", "a.tls: is not a SPICE kernel", put("a.tls", "hello")
    )
    yield row(
        "a folder without kernels", f"{INGEST} --kernels site", "site: holds no SPICE kernels ... check the folder"
    )
    yield row(
        "a folder without SUMFILEs", f"{INGEST} --sumfiles site", "site: holds no SUMFILEs (*.SUM); check the folder"
    )
    yield row(
        "an unknown place",
        "simulate --out out --preset moon",
        "no preset 'moon'; known: demo, cornelia, ahuna, ikapati, topshape, bilobed, potato",
    )
    yield row(
        "no shape of a body",
        "simulate --out out --shape none.obj",
        "none.obj: there is no such surface; check the path",
    )
    yield row(
        "a body with a hole",
        "simulate --out out --shape a.obj",
        "a.obj: is not a closed mesh whose faces all look the same way",
        put("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"),
    )
    yield row(
        "ground of a whole body",
        "simulate --out out --preset potato --surface a.obj",
        "--surface is ground of a place; give --shape for a whole body, or another preset",
    )
    yield row(
        "a boresight beside the image",
        "simulate --out out --intrinsics 500 500 3000 20",
        "the boresight (cx, cy) = (3000.0",
    )
    yield row(
        "no ground", "simulate --out out --surface none.ply", "none.ply: there is no such surface; check the path"
    )
    yield row(
        "damaged ground",
        "simulate --out out --surface a.obj",
        "a.obj: is not a complete OBJ file (vertex 1 has 2 coordinates, not 3); export it again",
        put("a.obj", "v 1 2\n"),
    )
    yield row(
        "a resolution without ground", "simulate --out out --gsd 5", "--gsd and --surface-center go with --surface"
    )
    yield row("a seed twice", "study --out out --seeds 1 1", "a study needs seeds, each once, got [1, 1]")
    yield row(
        "an image folder", "ingest photos --out out", "photos: is a folder; give the files in it, such as photos/*"
    )
    yield row(
        "a principal point far outside",
        f"{INGEST} --suns photos/suns.csv --pinhole 500 500 9999 20",
        f"{PHOTO}: the principal point [9999.0, 20.0] is far outside 60 x 40 pixels; the order is fx, fy, cx, cy; ...",
    )
    yield row(
        "a warning of a run is a number",
        "info mapped/run",
        f"{metrics}: is damaged (...); {run_again}",
        put(metrics, '{"warnings": [1]}'),
    )
    yield row(
        "a file for a model",
        "refine model/cameras.txt --out out",
        "model/cameras.txt/cameras.txt: cannot be read: Not a directory; give the folder of a model in text form",
    )
    yield row(
        "a study that holds out too many views",
        "study --out out --views 3 --hold-out-every 2",
        "--hold-out-every 2 leaves 2 of 3 views, at least 3 must remain to be mapped; give a larger number",
    )
    yield row(
        "a study of fewer images than views of a landmark",
        "study --out out --views 5 --run.densify.min-views 6",
        "5 views of each site are to be mapped, but landmarks are to be in 6 views at least; give more --views, or"
        " --run.densify.min-views 5",
    )
    yield row(
        "no network",
        "fetch --endpoint http://127.0.0.1:9",
        "travisdriver/phomo-data: ... cannot be fetched ... check the network",
        code=1,
    )


def disks() -> Iterator[Fault]:
    row = rows("disk", code=1)
    large = "cannot be written: File too large; the file system or a limit forbids files of this size"
    yield row("full at the first file of a run", RUN, f"map/lock: {large}", disk=10)
    yield row("full at an export", f"{EXPORT} --products csv", f"out/landmarks.csv: {large}", disk=300)
    yield row("full at a page", "view mapped/run --no-browser", f"mapped/run/report/viewer.html: {large}", disk=300)
    yield row("full at a rendering", "render mapped/run --out a.fits", f"a.fits: {large}", disk=300)
    yield row("full at a figure", FIGURE, f"a.pdf: {large}", disk=300)
    yield row(
        "full at an evaluation", f"{EVALUATE} --no-images", f"mapped/run/evaluation/evaluation.json: {large}", disk=300
    )
    yield row("full at an ingestion", f"{ALL} {SUNS}", f"out/images/20190301T101500.fits: {large}", disk=300)
    yield row("full at a choice of views", f"{VIEWS} 10 5 --out new", f"new/site.toml: {large}", disk=300)
    far = "cannot be written: File too large"
    begun = ("finished stages",)
    computes = "test_disk_full.py::test_a_command_that_computes"
    yield row("full at the truth of a place", "simulate --out out", f"out/truth.h5: {far}", test=computes)
    yield row(
        "full at the truth of a body", "simulate --preset bilobed --out out", f"out/truth.h5: {far}", test=computes
    )
    yield row(
        "full at a site of a study",
        "study --out out",
        f"out/sites/.../truth.h5: {far}",
        left=("out/study.toml", "finished cells"),
        test=computes,
    )
    yield row(
        "full at a refinement",
        REFINE,
        f"out/stages/refine.npz: {far}",
        left=("out/run.json", "out/log", "finished stages"),
        test=computes,
    )
    full = "test_a_full_disk_ends_the_command_with_one_line"
    yield row("full at a plan", "plan priors", f"priors/plan/plan.json: {far}", test=f"test_plan.py::{full}")
    yield row(
        "full at a ranking of models",
        "photometry mapped/run",
        f"mapped/run/photometry/photometry.png: {far}",
        test=f"test_model_ranking.py::{full}",
    )
    yield row(
        "full in structure from motion",
        RUN,
        f"map/stages/sparse/...: {far}",
        left=begun,
        test="test_disk_full.py::test_the_sparse_stage",
    )
    yield row(
        "full at a stage's result",
        RUN,
        f"map/stages/dense.npz: {far}",
        left=begun,
        test="test_disk_full.py::test_a_stages_result",
    )
    yield row(
        "read-only, or of another computer that is away",
        RUN,
        "/home/me/.cache/kernel.nbi: Read-only file system; free some space, or choose another place",
        left=begun,
        test="test_disk_full.py::test_any_other_write_of_a_command",
    )


def ends() -> Iterator[Fault]:
    resumes = "the same command goes on from what is finished"
    stages, signal = ("finished stages",), "test_signals.py::test_a_signal_ends_a_command_with_one_line"
    row = rows("signals", left=stages)
    yield row("Ctrl-C", RUN, f"interrupted; {resumes}", code=130, test=signal)
    yield row("SIGTERM", RUN, f"terminated; {resumes}", code=143, test=signal)
    closed = f"terminated, since the session was closed; {resumes}"
    yield row("the session is closed (SIGHUP)", RUN, closed, code=129, test=signal)
    yield row("killed (SIGKILL)", RUN, "", code=137, test="test_run_lock.py::test_a_stale_lock_is_taken_over")
    yield row(
        "the reader of the output is gone",
        "--help",
        "",
        code=141,
        left=NOTHING,
        test="test_cli.py::test_a_reader_that_has_gone_is_not_complained_about",
    )
    row = rows("resources")
    yield row(
        "memory does not suffice",
        RUN,
        "out of memory (Unable to allocate ... give a smaller region, a larger stride",
        code=1,
        left=stages,
        test="test_faults.py::test_memory_that_does_not_suffice_is_told",
    )
    yield row(
        "an extra is not installed",
        EXPORT,
        "stack needs pancakes: pip install 'photoclinometry[breakfast]'",
        test="test_export.py::test_a_format_whose_extra_is_not_installed_names_it",
    )


FAULTS = (*images(), *suns(), *keys(), *options(), *folders(), *others(), *disks(), *ends())
