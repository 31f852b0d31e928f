"""What bop_toolkit's functions read of an export, and its errors; the checkout is on PYTHONPATH."""

import json
import sys
from pathlib import Path

import numpy as np
from bop_toolkit_lib import inout, misc, pose_error

root, estimates = Path(sys.argv[1]), json.loads(Path(sys.argv[2]).read_text())
models = inout.load_json(str(root / "models" / "models_info.json"), keys_to_int=True)
meshes = {n: inout.load_ply(str(root / "models" / f"obj_{n:06d}.ply"))["pts"] for n in models}
symmetries = {n: misc.get_symmetry_transformations(m, 0.01) for n, m in models.items()}
out = []
for scene in sorted(root.glob("*/[0-9]*")):
    cameras = inout.load_scene_camera(str(scene / "scene_camera.json"))
    poses = inout.load_scene_gt(str(scene / "scene_gt.json"))
    infos = inout.load_json(str(scene / "scene_gt_info.json"), keys_to_int=True)
    for number, camera in cameras.items():
        file = scene / "depth" / f"{number:06d}.png"
        depth = inout.load_depth(str(file)) * camera["depth_scale"] if file.exists() else None
        for i, (pose, info) in enumerate(zip(poses[number], infos[number], strict=True)):
            rotation, t, object_id = pose["cam_R_m2c"], pose["cam_t_m2c"], pose["obj_id"]
            mask, seen = (
                inout.load_im(str(scene / folder / f"{number:06d}_{i:06d}.png")) > 0
                for folder in ("mask", "mask_visib")
            )
            ys, xs = np.nonzero(seen)
            points, turns = meshes[object_id], symmetries[object_id]
            angle = np.radians(123.4)
            turn = np.array(
                [[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]], dtype=np.float64
            )
            k = camera["cam_K"]
            record = {
                "frame_id": number,
                "scene": scene.parent.name,
                "K": k.tolist(),
                "rotation": rotation.tolist(),
                "t_mm": t.ravel().tolist(),
                "centre_px": misc.project_pts(np.zeros((1, 3)), k, rotation, t)[0].tolist(),
                "mask_pixels": int(mask.sum()),
                "visible_pixels": int(seen.sum()),
                "mask_and_visible": int((mask & seen).sum()),
                "box": [int(v) for v in misc.calc_2d_bbox(xs, ys)] if len(xs) else None,
                "info": info,
                "symmetries": len(turns),
                "diameter_mm": float(misc.calc_pts_diameter(points[:: max(1, len(points) // 90)])),
                "mssd_of_truth": float(pose_error.mssd(rotation, t, rotation, t, points, turns)),
                "mspd_of_truth": float(pose_error.mspd(rotation, t, rotation, t, k, points, turns)),
                "mssd_turned": float(pose_error.mssd(rotation @ turn, t, rotation, t, points, turns)),
                "depth_mm_at_centre": None,
            }
            x, y = np.rint(record["centre_px"]).astype(int)
            if depth is not None and 0 <= y < depth.shape[0] and 0 <= x < depth.shape[1]:
                record["depth_mm_at_centre"] = float(depth[y, x])
            given = estimates.get(str(number))
            if given:
                r, s = np.array(given["R"]).reshape(3, 3), np.array(given["t"]).reshape(3, 1)
                record["mssd"] = float(pose_error.mssd(r, s, rotation, t, points, turns))
                record["mspd"] = float(pose_error.mspd(r, s, rotation, t, k, points, turns))
            out.append(record)
results = [
    {"scene_id": 0, "im_id": r["frame_id"], "obj_id": 1, "score": 1.0, "R": np.array(r["rotation"]),
     "t": np.array(r["t_mm"]).reshape(3, 1), "time": -1}
    for r in out
]  # fmt: skip
inout.save_bop_results(sys.argv[3], results)
assert inout.check_bop_results(sys.argv[3])[0]
print(json.dumps(out))
