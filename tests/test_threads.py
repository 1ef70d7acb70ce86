"""What several threads sum is what one sums. The suite itself runs in one thread a process."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

SUMS = """
import json
import numba
import numpy as np
from graphs import graph_of
from photoclinometry.adjust.graph.variables import Estimate
from scenes import synthetic_scene

scene = synthetic_scene(size=20, views=5, keypoint_noise_px=0.2, brightness_noise=0.01)
graph = graph_of(scene, reflectance_sigma=0.1).graph
parameters = np.zeros(len(scene.reflectance.parameters))
at = graph.linearize(Estimate(scene.views, scene.landmarks, np.zeros(3), parameters))
vector = np.random.default_rng(0).normal(size=at.gradient.shape).astype(np.float32)
found = [at.cost, at.gradient, at.diagonal, at.multiply(vector)]
print(json.dumps([numba.get_num_threads(), *(each.tolist() for each in found)]))
"""


def sums(threads):
    """Threads used, then cost, gradient, diagonal and a product of a small graph, in a process of its own."""
    paths = os.pathsep.join([str(Path(__file__).parent), *filter(None, [os.environ.get("PYTHONPATH")])])
    environment = {**os.environ, "NUMBA_NUM_THREADS": str(threads), "PYTHONPATH": paths}
    done = subprocess.run([sys.executable, "-c", SUMS], env=environment, capture_output=True, text=True, check=True)
    used, *found = json.loads(done.stdout)
    assert used == threads
    return found


@pytest.mark.slow
def test_two_and_three_threads_sum_what_one_does():
    alone = sums(1)
    for threads in (2, 3):
        for several, one in zip(sums(threads), alone, strict=True):
            np.testing.assert_allclose(several, one, rtol=1e-4, atol=1e-7 * np.abs(one).max())
