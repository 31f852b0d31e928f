"""The stream that exports, cards and pages are made from: frames, masks, splits, facts.

about: Facts of a dataset that exports and cards state: name, licence, how it was made, how to cite and to reproduce
    it
frames: The stream that every export is written from: frames with their image, camera, poses, masks, boxes and
    keypoints
masks: Masks: pixels that an outline covers, by exact areas; COCO's run-length encoding of them
splits: Splits of a dataset: which frames are for training, validation and tests, reproducible from a seed
"""
