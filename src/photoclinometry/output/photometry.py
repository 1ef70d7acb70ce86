"""A ranking of reflectance models as files: a table and a figure."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from photoclinometry.evaluate.model_ranking import ModelFit, ModelRanking
from photoclinometry.io.atomic import atomic_path
from photoclinometry.io.json_file import write_json


def write_photometry(folder: Path | str, ranking: ModelRanking) -> None:
    """photometry.json and photometry.png. Raises RunFolderError."""
    from photoclinometry.output.figures.photometry import draw_photometry

    folder = Path(folder)
    with atomic_path(folder / "photometry.png") as work:
        draw_photometry(work, ranking)
    write_json(folder / "photometry.json", document(ranking), indent=2)


def document(ranking: ModelRanking) -> dict[str, Any]:
    """The ranking as a JSON document."""
    return {
        "models": [_row(ranking, fit) for fit in ranking.fits],
        "left_out": [{"name": name, "reason": reason} for name, reason in ranking.left_out.items()],
        "phase_seen_deg": list(ranking.best.phases_seen_deg),
    }


def _row(ranking: ModelRanking, fit: ModelFit) -> dict[str, Any]:
    model = fit.reflectance
    rows = zip(model.parameter_names, model.values, fit.parameter_sigma, fit.determined, strict=True)
    return {
        "name": model.name,
        "error_percent": fit.error_percent,
        "level_percent": fit.level_percent,
        "as_good_as_the_best": ranking.is_as_good(fit),
        "parameters": [
            {"value": float(value), "sigma": float(sigma), "name": name, "determined": bool(known)}
            for name, value, sigma, known in rows
        ],
        "views": [
            {"error_percent": 100.0 * float(error), "name": name}
            for name, error in zip(ranking.views, fit.error, strict=True)
        ],
    }
