"""Exports: a dataset in the formats of others, each written, read back and checked.

bop: BOP: scenes of frames with poses in millimetres, masks, 16-bit depth, and a model of each kind of marker
camera_files: Camera files of other tools: COLMAP's text model, Kalibr's camchain, ROS's camera_info
causes: The likely cause of a difference between an export and its dataset, in words
check: An export held against its checksums, and against the dataset that it was made from: each frame is read back
coco: COCO: boxes, run-length masks and keypoints, with camera and pose in keys of their own
croissant: Croissant 1.1: croissant.json describes shards of images and a table of truth, each with its checksum
export: `roundel export`: a dataset in a format of others, with what of the truth the format cannot hold
huggingface: Hugging Face: Parquet with an image feature, and a card (README.md)
output: The folder of an export: it appears complete or not at all, with the checksum of each file and a manifest
reading: What exports are read back to, in Roundel's units and coordinates, whatever the format's
sample: A frame as one JSON object, for formats that hold any: WebDataset, Hugging Face, Croissant
trajectories: Trajectories for evo and others: poses of the camera in the frame of a marker, in metres
webdataset: WebDataset: shards of tar, each frame an image and a JSON object with the same key
yolo: YOLO: a line of numbers for each marker, for keypoints (`pose`) and for outlines (`segment`), and data.yaml
"""
