"""A study: YAML to checked sections, and which numbers each frame draws.

camera_section: The keys of a camera and of its motion: the lens, the shutter, the twists
identity: What a study and a frame are, as checksums: which study a dataset is of, and which numbers a frame was
    made from
layers: Layers of a study: a preset, over it what all groups share, over it a group's own keys
light_map: An environment map as a file: there, an OpenEXR image of a bearable size, and the one that was meant
light_section: The keys of light, and of what stands in its way
marker_section: The keys of a marker: what is printed, on what paper, and what the wall behind it looks like
sampling: Which number each frame draws for each spread of a study
schema: The keys of a study, as strict pydantic models: no unknown key, no infinite number, no surprise
section: What every section of a study is: strict, frozen, finite
sensor_file: Another sensor for a study that is rendered already: the keys of a `sensor:` section, laid over every
    group's own
sensor_section: The keys of a sensor, in the terms of EMVA 1288 (release 4.0, linear camera model), and of the file
    it delivers
study: A study: what is rendered, solved and validated, read from YAML into checked sections
values: A study's value: a number, or a spread of numbers that each frame draws from
yaml_reader: YAML as studies use it: YAML 1.2 scalars, every value with its line and column, nothing clever
"""
