"""Photoclinometry-from-Motion: poses, dense landmarks, normals and albedo from spacecraft images.

    import photoclinometry as pcm

    site = pcm.simulate("demo", "site")
    result = pcm.run(site, "run", reflectance="mcewen")
    print(pcm.evaluate(result, truth="site/truth.h5"))

The names below are the public interface. They are imported at their first use, so that `import photoclinometry` itself
takes no time.
"""

from __future__ import annotations

import sys
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from photoclinometry.adjust import Adjustment, AdjustOptions
    from photoclinometry.api.live_map import view
    from photoclinometry.api.maps import (
        adjust,
        choose_views,
        evaluate,
        export,
        plan,
        rank_reflectance,
        read_scene,
        read_site,
        reflectance,
        reflectance_models,
        run,
        simulate,
        write_scene,
    )
    from photoclinometry.api.measurements import distance, height_difference, slope, volume
    from photoclinometry.api.pictures import figure, plot, plot_profile, plot_residuals, render
    from photoclinometry.evaluate.evaluation import Evaluation
    from photoclinometry.evaluate.model_ranking import ModelRanking, RankingOptions
    from photoclinometry.io.site import Site
    from photoclinometry.model.camera import Camera
    from photoclinometry.model.errors import InputError, PhotoclinometryError, ReconstructionError
    from photoclinometry.model.image import Image
    from photoclinometry.model.reflectance import Reflectance
    from photoclinometry.model.scene import Scene
    from photoclinometry.output.export import ExportOptions
    from photoclinometry.output.figures.options import FigureOptions
    from photoclinometry.pipeline.presets import preset
    from photoclinometry.pipeline.products import RunResult
    from photoclinometry.pipeline.run import RunOptions
    from photoclinometry.plan.options import PlanOptions
    from photoclinometry.plan.run import Plan
    from photoclinometry.registration.view_choice import ViewChoice, ViewLimits
    from photoclinometry.rivals.compare import RivalComparison, RivalOptions, compare_rivals
    from photoclinometry.simulate.options import SimulationOptions
    from photoclinometry.surface.measure import Measured

__version__ = "0.1.0"

__all__ = [
    "AdjustOptions",
    "Adjustment",
    "Camera",
    "Evaluation",
    "ExportOptions",
    "FigureOptions",
    "Image",
    "InputError",
    "Measured",
    "ModelRanking",
    "PhotoclinometryError",
    "Plan",
    "PlanOptions",
    "RankingOptions",
    "ReconstructionError",
    "Reflectance",
    "RivalComparison",
    "RivalOptions",
    "RunOptions",
    "RunResult",
    "Scene",
    "SimulationOptions",
    "Site",
    "ViewChoice",
    "ViewLimits",
    "adjust",
    "choose_views",
    "compare_rivals",
    "distance",
    "evaluate",
    "export",
    "figure",
    "height_difference",
    "plan",
    "plot",
    "plot_profile",
    "plot_residuals",
    "preset",
    "rank_reflectance",
    "read_scene",
    "read_site",
    "reflectance",
    "reflectance_models",
    "render",
    "run",
    "simulate",
    "slope",
    "view",
    "volume",
    "write_scene",
]

_MODULE = {
    "AdjustOptions": "adjust",
    "Adjustment": "adjust",
    "Camera": "model.camera",
    "Evaluation": "evaluate.evaluation",
    "ExportOptions": "output.export",
    "FigureOptions": "output.figures.options",
    "Image": "model.image",
    "InputError": "model.errors",
    "Measured": "surface.measure",
    "ModelRanking": "evaluate.model_ranking",
    "PhotoclinometryError": "model.errors",
    "ReconstructionError": "model.errors",
    "Plan": "plan.run",
    "PlanOptions": "plan.options",
    "RankingOptions": "evaluate.model_ranking",
    "Reflectance": "model.reflectance",
    "RivalComparison": "rivals.compare",
    "RivalOptions": "rivals.compare",
    "RunOptions": "pipeline.run",
    "RunResult": "pipeline.products",
    "Scene": "model.scene",
    "SimulationOptions": "simulate.options",
    "Site": "io.site",
    "ViewChoice": "registration.view_choice",
    "ViewLimits": "registration.view_choice",
    "compare_rivals": "rivals.compare",
    "distance": "api.measurements",
    "figure": "api.pictures",
    "height_difference": "api.measurements",
    "plot": "api.pictures",
    "plot_profile": "api.pictures",
    "plot_residuals": "api.pictures",
    "preset": "pipeline.presets",
    "render": "api.pictures",
    "slope": "api.measurements",
    "view": "api.live_map",
    "volume": "api.measurements",
}
"""Where each public name is defined; those not listed are in `api.maps`."""


if not TYPE_CHECKING:  # checkers would take any name for one of this package

    def __getattr__(name: str) -> Any:
        if name not in __all__:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        value = getattr(import_module(f"{__name__}.{_MODULE.get(name, 'api.maps')}"), name)
        globals()[name] = value
        return value


def __dir__() -> list[str]:
    return sorted([*(name for name in globals() if name.startswith("__")), *__all__])


class _Package(ModuleType):
    """This package, in which the functions `adjust`, `evaluate`, `plan` and `simulate` go before subpackages so named.

    Importing a subpackage sets it as an attribute of its parent, which would hide the function. The subpackages are
    reached by `from photoclinometry.adjust import ...`.
    """

    def __setattr__(self, name: str, value: Any) -> None:
        if not (name in __all__ and isinstance(value, ModuleType)):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package
