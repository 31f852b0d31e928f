"""A study: from YAML to checked sections, and the values that each frame draws.

camera_section: Keys of the camera and its motion: lens, shutter, twists
identity: Identity of studies and frames as checksums
layers: Layers of a study: a preset, then shared keys, then a group's own keys
light_section: Keys of lights and occluders
marker_section: Keys of a marker: the print, its paper, and the wall behind it
pose_section: Keys of poses: of the marker, and of further markers beside it
sampling: Sampling: the value that each frame draws for each distribution of a study
schema: Keys of a study as strict pydantic models
section: Base class of all sections of a study: strict, frozen, finite
sensor_file: A `sensor:` section from its own file, applied to every group of a study
sensor_section: Keys of a sensor, in the terms of EMVA 1288 (release 4.0, linear camera model), and of the image
    file
study: A study: what is rendered, solved and validated, read from YAML into checked sections
values: Values of a study: a number, or a distribution that each frame draws from
world_files: Files that a world names: checked when the study is read, and recorded by their checksums
world_section: Keys of the world around the sheet: a place of ours, or the user's own scene or pictures
yaml_reader: YAML 1.2 scalars with the line and column of every value
"""
