"""A ranking of reflectance models as files: a table and a figure."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from photoclinometry.evaluate.model_ranking import ModelFit, ModelRanking
from photoclinometry.evaluate.tables import json_numbers
from photoclinometry.io.atomic import atomic_path, write_text


def write_photometry(folder: Path | str, ranking: ModelRanking) -> None:
    """photometry.json and photometry.png. Raises RunFolderError."""
    from photoclinometry.output.figures.photometry import draw_photometry

    folder = Path(folder)
    with atomic_path(folder / "photometry.png") as work:
        draw_photometry(work, ranking)
    write_text(folder / "photometry.json", json.dumps(document(ranking), indent=2) + "\n")


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
            json_numbers({"value": float(value), "sigma": float(sigma)}) | {"name": name, "determined": bool(known)}
            for name, value, sigma, known in rows
        ],
        "views": [
            json_numbers({"error_percent": 100.0 * float(error)}) | {"name": name}
            for name, error in zip(ranking.views, fit.error, strict=True)
        ],
    }
