"""Display of the result of a run: one line at the prompt, a table and a picture of the map in a notebook."""

from __future__ import annotations

from typing import TYPE_CHECKING

from photoclinometry.model.display import card, named, scene_caption, scene_picture, scene_table

if TYPE_CHECKING:
    from photoclinometry.pipeline.products import RunResult


def result_line(result: RunResult) -> str:
    """The result in one line."""
    scene, about = result.scene, result_table(result)
    verdict = "" if not result.trusted else f"{result.verdict}; "
    counts = f"{verdict}{len(scene.views)} views, {len(scene.landmarks)} landmarks"
    parts = [f"{key} {about[key]}" for key in ("mean PSNR", "estimate", "views left out") if key in about]
    parts += [f"{len(result.warnings)} warnings"] if result.warnings else []
    parts += [] if result.trusted else ["NOT TO BE TRUSTED"]
    return f"<RunResult {named(scene.name, scene.body)}: {'; '.join([counts, *parts])}; {result.folder}>"


def result_card(result: RunResult) -> str:
    """The result as HTML."""
    scene = result.scene
    title = f"RunResult {named(scene.name, scene.body)}"
    return card(title, scene_table(scene) | result_table(result), lambda: scene_picture(scene), scene_caption(scene))


def result_table(result: RunResult) -> dict[str, str]:
    """How the run went, in words and numbers."""
    psnr = result.metrics.get("psnr_mean_db")
    quality = {} if psnr is None else {"mean PSNR": f"{psnr:.1f} dB"}
    state = "converged" if result.adjustment.converged else f"not converged: {result.adjustment.message}"
    trust = {} if result.trusted else {"not to be trusted": "; ".join(result.distrust)}
    care = {"to take care of": "; ".join(result.care)} if result.care else {}
    warned = {"warnings": "; ".join(warned.line for warned in result.warnings)} if result.warnings else {}
    left_out = {"views left out": ", ".join(result.left_out)} if result.left_out else {}
    how = {**quality, "estimate": state, "verdict": result.verdict, **trust, **care}
    return {**how, **left_out, **warned, "report": str(result.report)}
