"""What webdataset, mlcroissant, datasets, pycolmap, evo and supervision read: others.py KIND FOLDER."""

import importlib
import json
import sys
from pathlib import Path

import numpy as np

kind, folder = sys.argv[1], Path(sys.argv[2])


def of_webdataset():
    """Keys, pixels and records of each sample."""
    import webdataset

    shards = sorted(str(p) for p in folder.glob("*.tar"))
    samples = webdataset.WebDataset(shards, shardshuffle=False).decode("pil").to_tuple("__key__", "png;jpg", "json")
    # "pil" gives colours: of grey images three times the same.
    return [{"key": k, "size": image.size, "levels": int(np.asarray(image, dtype=np.int64)[..., 0].sum()), "record": r}
            for k, image, r in samples]  # fmt: skip


def of_huggingface():
    """Rows of each split, with decoded images, offline."""
    datasets = importlib.import_module("datasets")

    loaded = datasets.load_dataset(str(folder))
    out = []
    for split, rows in loaded.items():
        for row in rows:
            image = row.pop("image")
            out.append(
                {
                    "split": split,
                    "size": image.size,
                    "levels": int(np.asarray(image, dtype=np.int64).sum()),
                    "record": row,
                }
            )
    return out


def of_croissant():
    """Issues, and records of each set."""
    import mlcroissant

    dataset = mlcroissant.Dataset(str(folder / "croissant.json"))
    issues = dataset.metadata.ctx.issues
    frames = [{k: v.decode() if isinstance(v, bytes) else v for k, v in r.items()} for r in dataset.records("frames")]
    markers = [{k: v.decode() if isinstance(v, bytes) else v for k, v in r.items()} for r in dataset.records("markers")]
    images = [r["images/content"].size for r in dataset.records("images_of_frames")]
    return {
        "errors": sorted(issues.errors),
        "warnings": sorted(issues.warnings),
        "frames": json.loads(json.dumps(frames, default=str)),
        "markers": json.loads(json.dumps(markers, default=str)),
        "images": images,
    }


def of_colmap():
    """Cameras and poses."""
    import pycolmap

    model = pycolmap.Reconstruction(str(folder / "sparse" / "0"))
    out = []
    for image in model.images.values():
        camera = model.cameras[image.camera_id]
        pose = image.cam_from_world() if callable(image.cam_from_world) else image.cam_from_world
        matrix = np.vstack([pose.matrix(), [0, 0, 0, 1]])
        # The origin of the world, imaged by COLMAP itself, in its pixels.
        centre = camera.img_from_cam(matrix[:3, 3][None])[0]
        out.append({"name": image.name, "model": str(camera.model), "params": camera.params.tolist(),
                    "pose": matrix.tolist(), "centre": np.asarray(centre).tolist()})  # fmt: skip
    return out


def of_trajectory():
    """Poses of TUM and KITTI files, and their difference by evo's own error."""
    from evo.core import metrics
    from evo.tools import file_interface

    out = {}
    for path in sorted(folder.iterdir()):
        if path.suffix == ".tum":
            read = file_interface.read_tum_trajectory_file(str(path))
        elif path.suffix == ".kitti":
            read = file_interface.read_kitti_poses_file(str(path))
        else:
            continue
        error = metrics.APE(metrics.PoseRelation.full_transformation)
        error.process_data((read, read))
        out[path.name] = {
            "valid": bool(read.check()[0]),
            "poses": [p.tolist() for p in read.poses_se3],
            "error": float(error.get_statistic(metrics.StatisticsType.max)),
        }
    return out


def of_yolo():
    """Boxes, outlines and classes of both tasks, as supervision reads them."""
    import supervision
    import yaml

    out = {}
    for task in ("pose", "segment"):
        data = yaml.safe_load((folder / task / "data.yaml").read_text())
        for split in sorted(p.name for p in (folder / task / "images").iterdir()):
            read = supervision.DetectionDataset.from_yolo(
                str(folder / task / "images" / split), str(folder / task / "labels" / split),
                str(folder / task / "data.yaml"), force_masks=task == "segment",
            )  # fmt: skip
            for path, _, found in read:
                masks = None if found.mask is None else [int(m.sum()) for m in found.mask]
                classes = [data["names"][int(c)] for c in found.class_id]
                out[f"{task}/{Path(path).stem}"] = {"boxes": found.xyxy.tolist(), "pixels": masks, "classes": classes}
    return out


print(json.dumps(globals()[f"of_{kind}"](), default=float))
