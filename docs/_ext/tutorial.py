"""Runs the commands of the tutorial, so that its output and pictures are those of the program as it is."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

DOCS = Path(__file__).parents[1]
PAGE = DOCS / "tutorial" / "first-map.md"
GENERATED = DOCS / "tutorial" / "generated"
PICTURES = ("reference", "albedo", "normals", "height")


def commands() -> list[list[str]]:
    """The tutorial's lines that call `phomo`, as lists of arguments."""
    lines = re.findall(r"^    phomo (.*)$", PAGE.read_text(encoding="utf-8"), flags=re.MULTILINE)
    return [line.split("#")[0].split() for line in lines]


def run(app: Any) -> None:
    """Runs them in build/tutorial, and keeps what they print and draw in tutorial/generated/."""
    if not app.config.run_tutorial:
        return
    folder = DOCS.parent / "build" / "tutorial"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    GENERATED.mkdir(exist_ok=True)
    wide = os.environ | {"COLUMNS": "110"}
    start = "import sys; from photoclinometry.cli import main; main(sys.argv[1:])"
    for arguments in commands():
        command = [sys.executable, "-c", start, *arguments]
        done = subprocess.run(command, cwd=folder, env=wide, capture_output=True, text=True)
        if done.returncode:
            raise RuntimeError(f"the tutorial's command `phomo {' '.join(arguments)}` failed:\n{done.stderr}")
        (GENERATED / f"{arguments[0]}.txt").write_text(done.stdout or done.stderr, encoding="utf-8")
    for name in PICTURES:
        shutil.copy(folder / "run" / "report" / f"{name}.png", GENERATED)
    _as_8_bits(folder / "relit.png", GENERATED / "relit.png")


def _as_8_bits(source: Path, target: Path) -> None:
    """A linear 16-bit rendering as a picture for the screen, cut to the map and three times as large."""
    import cv2
    import numpy as np

    image = cv2.imread(str(source), cv2.IMREAD_UNCHANGED).astype(float)
    rows, cols = np.nonzero(image)
    image = image[rows.min() : rows.max() + 1, cols.min() : cols.max() + 1]
    shown = 255.0 * (image / np.percentile(image, 99.5)).clip(0.0, 1.0) ** (1 / 2.2)
    cv2.imwrite(str(target), cv2.resize(shown, None, fx=6, fy=6, interpolation=cv2.INTER_NEAREST).astype(np.uint8))


def setup(app: Any) -> dict[str, bool]:
    app.add_config_value("run_tutorial", True, "env")
    app.connect("builder-inited", run)
    return {"parallel_read_safe": True}
