"""What pycocotools reads of an export: masks, boxes, keypoints; COCOeval's precision of the truth itself."""

import contextlib
import io
import json
import sys
from pathlib import Path

import numpy as np
from pycocotools import mask as masks
from pycocotools.coco import COCO
from pycocotools.cocoeval import COCOeval

out = {"annotations": [], "precision": []}
for path in sorted(Path(sys.argv[1], "annotations").glob("*.json")):
    with contextlib.redirect_stdout(io.StringIO()):
        truth = COCO(path)
    found = truth.loadAnns(truth.getAnnIds())
    results = {"bbox": [], "segm": [], "keypoints": []}
    for a in found:
        image = truth.loadImgs(a["image_id"])[0]
        mask = truth.annToMask(a)
        whole = masks.decode(masks.frPyObjects(a["segmentation_full"], image["height"], image["width"]))
        ys, xs = np.nonzero(mask)
        out["annotations"].append(
            {
                "image": image["file_name"],
                "marker_id": a["marker_id"],
                "category": truth.loadCats(a["category_id"])[0]["name"],
                "mask_pixels": int(mask.sum()),
                "full_pixels": int(whole.sum()),
                # Of its pixels' centres, counted from the corner.
                "mask_centre": [float(xs.mean() + 0.5), float(ys.mean() + 0.5)],
                "bbox": a["bbox"],
                "keypoints": a["keypoints"],
                "K": image["K"],
                "pose": a["camera_from_marker"],
            }
        )
        common = {"image_id": a["image_id"], "category_id": a["category_id"], "score": 1.0}
        encoded = masks.encode(np.asfortranarray(mask))
        encoded["counts"] = encoded["counts"].decode()
        results["bbox"].append({**common, "bbox": a["bbox"]})
        results["segm"].append({**common, "segmentation": encoded})
        results["keypoints"].append({**common, "keypoints": a["keypoints"]})
    for kind, mine in results.items():
        with contextlib.redirect_stdout(io.StringIO()):
            scored = COCOeval(truth, truth.loadRes(mine), kind)
            if kind == "keypoints":
                # Five keypoints, where the default has the 17 of a person.
                scored.params.kpt_oks_sigmas = np.full(5, 0.05)
            scored.evaluate()
            scored.accumulate()
            scored.summarize()
        out["precision"].append([path.stem, kind, float(scored.stats[0])])
print(json.dumps(out))
