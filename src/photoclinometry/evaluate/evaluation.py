"""One evaluation of a map: how well it explains its images, and how far it is from the truth or another map."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from photoclinometry.evaluate.compare import Comparison, evaluate_against_map, evaluate_against_truth
from photoclinometry.evaluate.evaluate import evaluate_scene, held_out_table
from photoclinometry.evaluate.tables import markdown
from photoclinometry.io.reference import Reference
from photoclinometry.model.geometry import METRES, Similarity
from photoclinometry.model.image import Image
from photoclinometry.model.scene import Scene, Views
from photoclinometry.simulate.truth import Truth


@dataclass(frozen=True, kw_only=True)
class Evaluation:
    """The figures of a map, and the comparison from which some of them come. Printed, they are tables."""

    name: str
    """The scene's name."""
    metrics: dict[str, float]
    """Every figure by name; the unit ends the name."""
    comparison: Comparison | None = None
    """With the truth or another map: the aligned scene and the errors of every landmark."""
    unit: str = "m"
    """Unit of length of the reference."""

    @property
    def metres_from_scene(self) -> Similarity | None:
        """The alignment with the reference, in metres; None where there is none, or no known unit."""
        if self.comparison is None or self.unit not in METRES:
            return None
        return Similarity(METRES[self.unit], np.eye(3), np.zeros(3)) @ self.comparison.similarity

    def markdown(self) -> str:
        """The figures as two tables in Markdown."""
        return markdown(self.metrics, f"Evaluation of {self.name}")

    def __str__(self) -> str:
        return self.markdown()


def evaluate_map(
    scene: Scene,
    *,
    images: Sequence[Image] | None = None,
    held_out: Views | None = None,
    truth: Truth | None = None,
    reference: Reference | None = None,
    unit: str = "m",
) -> Evaluation:
    """The figures of a scene, from the images and references that are given.

    images: those of the scene's views and of `held_out`, in any order; without them there is no PSNR and no
    completeness. held_out: views in the scene's frame that were kept out of it. reference: a map in lengths of `unit`;
    its poses, where it has any, give the first alignment. Raises InputError.
    """
    rows = held_out_table(scene, held_out, images) if held_out is not None else ()
    metrics = evaluate_scene(scene, images, held_out=rows)
    found = None
    if truth is not None:
        found = evaluate_against_truth(scene, truth)
    elif reference is not None:
        names, poses = reference.names, reference.body_from_cam
        found = evaluate_against_map(scene, reference.surface, names=names, body_from_cam=poses, unit=unit)
    if found is not None:
        metrics |= found.metrics
    return Evaluation(name=scene.name, metrics=metrics, comparison=found, unit=unit)
