"""The models for a graphics processor, as functions of GLSL: the `.glsl` files beside the models' Python.

`Model.shader` is an expression in these functions. The array p is `Reflectance.parameter_vector`, so that its indices
are those of the compiled functions; `p_count` is its length. `tests/test_viewer_light.py` compares every model with the
compiled one.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

from photoclinometry.model.reflectance.angles import DEG, PHASE_FLOOR

MOST_PARAMETERS = 32
"""Length of p in the shader: Hapke's 14 numbers, and polynomials of any sensible degree."""

_FILES = ("phase_functions", "akimov", "lunar_lambert", "minnaert", "hapke")


@cache
def shader_functions() -> str:
    """Constants, the array p, and the functions that the expressions of the models use."""
    head = (
        f"const float PI = 3.141592653589793;\nconst float DEG = {DEG!r};\n"
        f"const float PHASE_FLOOR = {PHASE_FLOOR!r};\n"
        f"uniform float p[{MOST_PARAMETERS}];\nuniform int p_count;\n"
    )
    paths = (Path(__file__).with_name(f"{name}.glsl") for name in _FILES)
    return "\n".join([head, *(path.read_text(encoding="utf-8") for path in paths)])
