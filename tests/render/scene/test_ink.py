"""The ink plugin against its definition: float32 rays and float64 truth agree to float32 precision."""

from typing import Any

import numpy as np
import pytest
from helpers_markers import MARKERS, sheet

from roundel.scenes.geometry.pose import camera_from_marker_of, normal_of, transform_points
from roundel.scenes.markers.ink_pattern import reflectance_at

EVERYTHING: dict[str, Any] = {
    "edge_softness_m": 0.001,
    "grain": 0.05,
    "clutter": {"cell_m": 0.03, "contrast": 0.4},
}


def painted(mi: Any, made: Any, pose: np.ndarray) -> Any:
    texture = mi.load_dict({"type": "roundel_ink"})
    texture.paint(made, pose)
    return texture


@pytest.mark.parametrize("everything", [False, True], ids=["sharp", "everything"])
@pytest.mark.parametrize("kind", MARKERS)
def test_rays_see_the_ink_that_is_defined(mi, kind: str, everything: bool) -> None:
    made = sheet(kind, seed=0xFFFFFFF1, **(EVERYTHING if everything else {}))
    texture = painted(mi, made, np.eye(4))
    low, high = np.array(made.low_m) - 0.05, np.array(made.high_m) + 0.05
    p = (low + (high - low) * np.random.default_rng(4).random((100_000, 2))).astype(np.float32)
    got = np.array(texture.reflectance_at(mi.Float(p[:, 0]), mi.Float(p[:, 1])), dtype=np.float64)
    x, y = p.astype(np.float64).T
    # Steps as large as float32's rounding of a few operations on 0.2 m. Where the definition changes within them, the
    # rays may see any of its values; elsewhere they must see this one. A soft edge is off by that step over its width
    # (1e-4 of the contrast), grain by less.
    step = 1e-7
    near = np.stack([reflectance_at(made, x + a, y + b) for a in (-step, 0, step) for b in (-step, 0, step)])
    tolerance = 1e-4 if everything else 1e-7
    assert np.all(got >= near.min(axis=0) - tolerance)
    assert np.all(got <= near.max(axis=0) + tolerance)
    # And places where that leaves much open are few.
    assert np.mean(np.ptp(near, axis=0) > 0.01) < 1e-3


def test_points_of_the_world_are_taken_to_the_sheet(mi) -> None:
    made = sheet("charuco")
    pose = camera_from_marker_of(normal_of(30.0, 50.0), [0.1, -0.05, 0.7], 20.0)
    flat = np.array([[0.0113, 0.0217, 0.0], [-0.07, 0.055, 0.0], [-0.0524, 0.0312, 0.0], [0.0, 0.2, 0.0]])
    world = transform_points(pose, flat).astype(np.float32)
    seen = painted(mi, made, pose).reflectance(mi.Point3f(*(mi.Float(c) for c in world.T)))
    np.testing.assert_allclose(np.array(seen), reflectance_at(made, flat[:, 0], flat[:, 1]), rtol=1e-6)


@pytest.mark.parametrize("kind", ["disc", "dot_ring", "charuco", "tags"])
def test_frames_share_one_kernel_whatever_their_numbers(mi, kind: str) -> None:
    import drjit as dr

    # Other sizes, another seed, and of boards other counts: the table of the tags changes, not the code.
    other = {"columns": 6, "rows": 3, "first_id": 9} if kind in ("charuco", "tags") else {"diameter_m": 0.03}
    sheets = [
        sheet(kind, seed=1, **EVERYTHING),
        sheet(kind, seed=2, **{**EVERYTHING, "edge_softness_m": 0.0007, "grain": 0.02}, **other),
    ]
    x = mi.PCG32(size=1000).next_float32() * 0.3 - 0.15
    dr.eval(x)
    hits = []
    for made in sheets:
        with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
            dr.kernel_history_clear()
            dr.eval(painted(mi, made, np.eye(4)).reflectance_at(x, x * 0.5))
            hits.append([entry["hash"] for entry in dr.kernel_history([dr.KernelType.JIT])])
    assert hits[0] == hits[1]
    assert len(hits[0]) == 1
