"""Robust bundle adjustment of pycolmap reconstructions: of a whole one, and of one view with its points."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

LOSS_PX = 0.3
"""Scale of the soft-L1 loss: the keypoints' precision. Shadow edges, which move with the Sun, give residuals long
tails; with this loss rotation errors on simulated sites are a quarter smaller."""

ITERATIONS, TOLERANCE = 50, 1e-8
"""Largest number of iterations, and the relative decrease of cost that ends them."""


@dataclass(frozen=True)
class RobustAdjustment:
    """Adjusts reconstructions in place, with fixed intrinsics and a loss that matches the keypoints' precision."""

    threads: int = 1

    def of_model(self, model: Any) -> None:
        """All poses and points; two cameras hold the frame."""
        import pycolmap

        problem = pycolmap.BundleAdjustmentConfig()
        for image_id in model.reg_image_ids():
            problem.add_image(image_id)
        problem.fix_gauge(pycolmap.BundleAdjustmentGauge.TWO_CAMS_FROM_WORLD)
        self._solve(model, problem, ITERATIONS)
        model.update_point_3d_errors()

    def of_view(self, model: Any, image_id: int) -> float:
        """The pose of an image and the points that it sees, other poses held. Returns the cost of these points."""
        return self._solve(model, self._of_view(model, image_id), ITERATIONS).final_cost

    def cost_of_view(self, model: Any, image_id: int) -> float:
        """The initial cost of `of_view`."""
        return self._solve(model, self._of_view(model, image_id), 0).initial_cost

    @staticmethod
    def _of_view(model: Any, image_id: int) -> Any:
        import pycolmap

        problem = pycolmap.BundleAdjustmentConfig()
        problem.add_image(image_id)
        for keypoint in keypoints_with_points(model.images[image_id]):
            problem.add_variable_point(keypoint.point3D_id)
        return problem

    def _solve(self, model: Any, problem: Any, iterations: int) -> Any:
        # Not pycolmap.bundle_adjustment, which prints at any log level.
        import pycolmap

        options = pycolmap.BundleAdjustmentOptions()
        options.refine_focal_length = False
        options.refine_principal_point = False
        options.refine_extra_params = False
        options.refine_sensor_from_rig = False
        options.ceres.use_gpu = False
        options.ceres.loss_function_type = pycolmap.LossFunctionType.SOFT_L1
        options.ceres.loss_function_scale = LOSS_PX
        options.ceres.solver_options.num_threads = self.threads
        options.ceres.solver_options.max_num_iterations = iterations
        options.ceres.solver_options.function_tolerance = TOLERANCE
        options.print_summary = False
        summary: Any = pycolmap.create_default_bundle_adjuster(options, problem, model).solve()
        return summary.ceres_summary


def keypoints_with_points(image: Any) -> list[Any]:
    """The keypoints of a pycolmap image that show a point of its reconstruction."""
    return [keypoint for keypoint in image.points2D if keypoint.has_point3D()]
