"""The report of a body: its first screen says what the surface and its figures say, and where the worst places are."""

import re
from dataclasses import replace

import numpy as np
import pytest

from photoclinometry.evaluate.verdict import CARE, SOUND, WRONG, Judgement, why_body_with_care
from photoclinometry.model.warning import MANY_ALIKE, Warned, few_of_each
from photoclinometry.output.report.body_overview import body_overview, phases_deg, views_per_vertex
from photoclinometry.output.report.body_places import body_places
from photoclinometry.output.report.body_report import BodyContent, write_body_report
from photoclinometry.output.report.sides import PIXELS, SIDES, best_seen, seen_from, titles
from photoclinometry.surface.mesh_rays import MeshRays
from viewer_bodies import DIRECTIONS, RADIUS, body_of, round_one

pytest.importorskip("embreex")

METRICS = {
    "images": 12,
    "images_registered": 10,
    "images_placed_by_surface": 2,
    "tiles": 2,
    "tiles_mapped": 2,
    "tiles_untrusted": 0,
    "landmarks": 12345,
    "facets": 800,
    "mapped_percent": 98.7,
    "mean_radius": 200.0,
    "volume": 33_510_000.0,
    "volume_sigma": 45_000.0,
    "longest_extent": 400.0,
    "middle_extent": 390.0,
    "shortest_extent": 380.0,
    "height_sigma_median_gsd": 0.15,
    "normal_sigma_median_deg": 3.06,
    "albedo_sigma_median_percent": 1.5,
    "step_between_tiles_median_gsd": 0.04,
    "psnr_mean_db": 28.84,
    "psnr_min_db": 24.4,
}
TILES = [{"tile": 0, "used": True}, {"tile": 1, "used": True}]


@pytest.fixture(scope="module")
def body():
    """A sphere of 200 m that seven images see everywhere; x < 0 is tile 0, x > 0 tile 1."""
    found = body_of(round_one, spacing=15.0)
    count = len(found.shape.vertices)
    tile = (found.shape.vertices[:, 0] > 0).astype(int)
    stated = {name: np.full(count, value) for name, value in (("height", 0.5), ("normal", 0.05), ("albedo", 0.02))}
    return replace(found, shape=replace(found.shape, views=np.full(count, 7), tile=tile, sigma=stated))


def no_steps(body):
    return np.full(len(body.shape.vertices), np.nan)


def seen_first(body, metrics=METRICS, tiles=TILES):
    """The overview of a body of which nothing was warned."""
    care = why_body_with_care(metrics, tiles, views_per_vertex(body.shape))
    return body_overview(body, no_steps(body), metrics, Judgement(care=tuple(care)))


def told(found):
    return {fact.name: fact.value for fact in (*found.what, *found.quality)}


def test_the_facts_are_those_of_the_body_and_its_figures(body):
    found = seen_first(body)
    facts = told(found)
    assert facts["Size"] == "400 x 390 x 380 m"
    assert facts["Volume"] == "33\u202f510\u202f000 ± 45\u202f000 m³"
    assert facts["GSD"] == "3.33 m"
    assert facts["Surface"] == "98.7 % mapped"
    assert facts["Images"] == "12 of 12 used"
    assert facts["Tiles"] == "2 of 2 mapped"
    assert facts["Heights"] == "± 0.15 GSD = 0.50 m"
    assert facts["Normals"] == "± 3.1°"
    assert facts["Albedos"] == "± 1.5 %"
    assert facts["Tiles agree"] == "to 0.040 GSD = 0.13 m"
    assert facts["PSNR"] == "28.8 dB"
    assert found.verdict == SOUND
    assert found.reasons == found.places == ()


def test_lengths_of_large_bodies_are_kilometres_and_of_images_alone_ground_samples(body):
    large = METRICS | {name: 1e3 * METRICS[name] for name in ("longest_extent", "middle_extent", "shortest_extent")}
    facts = told(seen_first(body, large | {"volume": 33.51e15, "volume_sigma": 45e12}))
    assert (facts["Size"], facts["Volume"]) == ("400 x 390 x 380 km", "33\u202f510\u202f000 ± 45\u202f000 km³")
    alone = replace(body, shape=replace(body.shape, unit=None), body_fixed=False)
    facts = told(seen_first(alone))
    assert facts["Size"] == "120 x 117 x 114 GSD"
    assert facts["GSD"] == "of unknown length"
    assert facts["Heights"] == "± 0.15 GSD"


def test_light_is_the_phase_at_the_middle_of_the_body(body):
    """The cameras look at the origin, and the sphere is about it."""
    ways = np.array(DIRECTIONS) / np.linalg.norm(DIRECTIONS, axis=-1, keepdims=True)
    expected = np.degrees(np.arccos(np.sum(ways * body.views.sun, -1)))
    np.testing.assert_allclose(phases_deg(body), expected, atol=1e-6)


@pytest.mark.parametrize(
    ("figures", "words"),
    [
        ({"images": 15}, "left out, since they have no pose: 3 of 15 images"),
        ({"tiles_untrusted": 1}, "1 of 2 tiles are not to be trusted"),
        ({"mapped_percent": 88.0}, "12 % of the surface were never mapped"),
        ({"normal_sigma_median_deg": 9.0}, "normals are uncertain: 9.00°"),
        ({"height_sigma_median_gsd": 0.8}, "heights are uncertain: 0.800 GSD"),
        ({"psnr_mean_db": 20.0}, "mean PSNR 20.0 dB"),
    ],
)
def test_doubtful_figures_make_a_body_one_to_take_care_of(body, figures, words):
    found = seen_first(body, METRICS | figures)
    assert found.verdict == CARE
    (reason,) = found.reasons
    assert words in reason


def test_tiles_without_a_map_and_few_images_are_told(body):
    tiles = [TILES[0], {"tile": 1, "used": False}]
    assert seen_first(body, tiles=tiles).reasons == ("1 of 2 tiles have no map: 1",)
    seldom = replace(body, shape=replace(body.shape, views=np.full(len(body.shape.vertices), 3)))
    (reason,) = seen_first(seldom).reasons
    assert reason.startswith("few views: 3.0")


def test_of_many_warnings_of_one_kind_the_first_are_listed():
    alike = [Warned("view-unregistered", f"{n} is left out", f"{n}") for n in range(MANY_ALIKE + 4)]
    lines = few_of_each([*alike, Warned("tile-failed", "tile 3 is not mapped")])
    assert lines[:2] == ["0 is left out [view-unregistered]", "1 is left out [view-unregistered]"]
    assert lines[MANY_ALIKE] == "and 4 more like it, listed in metrics.json [view-unregistered]"
    assert lines[-1] == "tile 3 is not mapped [tile-failed]"


def test_the_worst_places_are_where_the_surface_is_bad(body):
    """Tile 1 is uncertain and seen seldom, and named once; nothing was mapped about the north pole."""
    shape, north = body.shape, np.array([0.0, 0.0, 1.0])
    east = shape.tile == 1
    sigma = {name: np.where(east, 4.0 * values, values) for name, values in shape.sigma.items()}
    gap = shape.vertices @ north > 0.9 * RADIUS
    bad = replace(shape, sigma=sigma, views=np.where(gap, 0, np.where(east, 2, 7)), tile=np.where(gap, -1, shape.tile))
    pole, tile = body_places(bad, no_steps(body), body.gsd)
    assert pole.where.endswith("° N")
    assert shape.vertices[pole.vertex] @ north > 0.95 * RADIUS
    share = float(pole.words.removeprefix("no map: ").split(" %")[0])
    assert share == pytest.approx(5.0, abs=1.0)  # a cap of 0.1 of the radius is 5 % of a sphere
    assert tile.where.startswith("tile 1, around ")
    assert tile.words.startswith("fewest images: 2 in the mean, of the whole surface 4.")
    assert shape.vertices[tile.vertex][0] > 0.9 * RADIUS


def test_a_model_made_of_images_alone_has_no_longitudes(body):
    own = replace(body.shape, unit=None, views=np.where(body.shape.vertices[:, 2] > 0.9 * RADIUS, 0, 7))
    (gap, *_) = body_places(own, no_steps(body), body.gsd)
    assert re.fullmatch(r"around \d+° from x to y, \d+° towards z", gap.where)
    assert titles(own) == ["from +x", "from +y", "from -x", "from -y", "from +z", "from -z"]
    assert titles(body.shape)[0] == "0° E"


def test_a_place_is_marked_on_the_side_that_sees_it(body):
    rays = MeshRays(body.shape.vertices, body.shape.faces, 15.0)
    sides = [seen_from(rays, np.array(towards)) for *_, towards in SIDES]
    for number, (*_, towards) in enumerate(SIDES):
        side, place = best_seen(rays, sides, RADIUS * np.array(towards), np.array(towards))
        assert side == number
        assert place == pytest.approx((PIXELS / 2, PIXELS / 2))
    up = np.array([0.6, 0.0, 0.8])
    side, (x, y) = best_seen(rays, sides, RADIUS * up, up)
    assert SIDES[side][0] == "north"
    assert x == pytest.approx(PIXELS / 2)
    assert y < PIXELS / 2  # 0 degrees east is up


def test_the_page_begins_with_verdict_facts_and_places(body, tmp_path):
    content = BodyContent(
        name="a ball",
        metrics=METRICS,
        tiles=TILES,
        views=[{"name": "a", "used": True}],
        stages=[],
        options={"plan": {"tile_px": "<64>"}},
        judgement=Judgement(
            warnings=(Warned("view-unregistered", "b is left out", "b"),), distrust=("no <b> is to be trusted",)
        ),
    )
    html = write_body_report(tmp_path / "report", body, no_steps(body), content).read_text(encoding="utf-8")
    what = ("What was mapped", "How good it is", "Worst places", "overview.png")
    parts = (f"<b>{WRONG.capitalize()}:</b>", "no &lt;b&gt; is", "1 warning<", "b is left out", *what)
    assert sorted(map(html.index, parts)) == [html.index(part) for part in parts]
    assert "plan.tile_px = &lt;64&gt;" in html
    assert (tmp_path / "report" / "overview.png").stat().st_size > 3000
