"""Roundel: ray-traced datasets of circular markers, pose from a single circle, and its validation.

What is listed in `__all__` is the public interface. Each name is imported when it is first used, so that
`import roundel` takes no time and loads neither OpenCV nor Mitsuba.

Examples
--------
>>> import roundel
>>> roundel.poses_from_conic.__module__
'roundel.solver.pose.circle_pose'
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from roundel.datasets.dataset import Dataset, open_dataset, read_truth
    from roundel.datasets.layout.images import open_images
    from roundel.render.run import render_study
    from roundel.scenes.camera.model import Camera
    from roundel.scenes.errors import DataError, NotComparableError, RoundelError, StudyError, UsageError
    from roundel.scenes.geometry.conic import Ellipse, conic_of_circle, conic_of_ellipse, ellipse_of_conic
    from roundel.scenes.study.study import Study, load_study
    from roundel.solver.estimates import Estimate
    from roundel.solver.methods.locate import locate
    from roundel.solver.methods.solve import solve_dataset
    from roundel.solver.pose.circle_pose import CirclePoses, poses_from_conic, poses_from_ellipse
    from roundel.solver.tracking.tracker import TrackedMarker, Tracker
    from roundel.validate.estimates.reader import read_estimates
    from roundel.validate.metrics.pose_errors import normal_error_deg
    from roundel.validate.scores.report_files import read_scores
    from roundel.validate.validate import validate_dataset

    __version__: str

__all__ = [
    "Camera",
    "CirclePoses",
    "DataError",
    "Dataset",
    "Ellipse",
    "Estimate",
    "NotComparableError",
    "RoundelError",
    "Study",
    "StudyError",
    "TrackedMarker",
    "Tracker",
    "UsageError",
    "__version__",
    "conic_of_circle",
    "conic_of_ellipse",
    "ellipse_of_conic",
    "load_study",
    "locate",
    "normal_error_deg",
    "open_dataset",
    "open_images",
    "poses_from_conic",
    "poses_from_ellipse",
    "read_estimates",
    "read_scores",
    "read_truth",
    "render_study",
    "solve_dataset",
    "validate_dataset",
]

# Where each public name is defined; tests/test_front_door.py holds this, `__all__` and the imports above together.
_MODULES = {
    "Camera": "scenes.camera.model",
    "CirclePoses": "solver.pose.circle_pose",
    "DataError": "scenes.errors",
    "Dataset": "datasets.dataset",
    "Ellipse": "scenes.geometry.conic",
    "Estimate": "solver.estimates",
    "NotComparableError": "scenes.errors",
    "RoundelError": "scenes.errors",
    "Study": "scenes.study.study",
    "StudyError": "scenes.errors",
    "TrackedMarker": "solver.tracking.tracker",
    "Tracker": "solver.tracking.tracker",
    "UsageError": "scenes.errors",
    "conic_of_circle": "scenes.geometry.conic",
    "conic_of_ellipse": "scenes.geometry.conic",
    "ellipse_of_conic": "scenes.geometry.conic",
    "load_study": "scenes.study.study",
    "locate": "solver.methods.locate",
    "normal_error_deg": "validate.metrics.pose_errors",
    "open_dataset": "datasets.dataset",
    "open_images": "datasets.layout.images",
    "poses_from_conic": "solver.pose.circle_pose",
    "poses_from_ellipse": "solver.pose.circle_pose",
    "read_estimates": "validate.estimates.reader",
    "read_scores": "validate.scores.report_files",
    "read_truth": "datasets.dataset",
    "render_study": "render.run",
    "solve_dataset": "solver.methods.solve",
    "validate_dataset": "validate.validate",
}


def __getattr__(name: str) -> Any:
    value: Any
    if name == "__version__":
        from importlib.metadata import version

        value = version("roundel")
    elif name in _MODULES:
        from importlib import import_module

        value = getattr(import_module(f"roundel.{_MODULES[name]}"), name)
    else:
        raise AttributeError(f"module 'roundel' has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
