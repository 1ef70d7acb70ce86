"""`phomo measure` prints what the library measures."""

import numpy as np

import photoclinometry as pcm
from commands import phomo
from measured_maps import flat, map_of_heights, outline_of, pixel_of
from photoclinometry.io.scene_file import write_scene


def test_lines_and_outlines_are_measured(tmp_path, capsys):
    height = flat()
    height[8:13, 8:13] = 1.0
    scene = map_of_heights(height)
    write_scene(tmp_path / "scene.h5", scene)
    start, end = pixel_of(scene, 2, 3), pixel_of(scene, 6, 6)
    corners = outline_of(scene, 5, 15)
    assert phomo("measure", tmp_path / "scene.h5", "--line", *start, *end, "--outline", *np.ravel(corners)) == 0
    said = capsys.readouterr().out.splitlines()
    assert said == [
        f"distance: {pcm.distance(scene, start, end)}",
        f"height of the second place over the first: {pcm.height_difference(scene, start, end)}",
        f"slope upwards: {pcm.slope(scene, start, end)}",
        f"volume: {pcm.volume(scene, corners.tolist())}",
    ]
    assert said[0].startswith("distance: 10.")
