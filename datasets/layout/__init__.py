"""The files of a dataset: names, formats, the write protocol.

camera_records: The camera records of a dataset's frames, a shard at a time: memory does not grow with their number
contents: What a dataset holds: its identity, its shards, the checksums of their files; nothing of its study or truth
developed: Whose radiance the frames of a developed (re-exposed) dataset have
files: Names of the files of a dataset
images: Images and cameras of a dataset: everything that a solver may open
journal: The journal of a finished shard: one line per frame, sorted, each with a checksum of its own
manifest: The manifest of a dataset, read and checked; that of each shard, where there are several
masks: Depth and coverage of a frame's markers: from its radiance, or from masks/ where the radiance is not kept
radiance: Linear radiance on disk: OpenEXR, float32, with its Monte-Carlo variance, depth and coverage
schema: The records of a dataset as strict schemas: what is read from disk has every key, in range, and no other
shards: Shards: a dataset's frames in folders of a fixed number, each complete in itself
sweeps: Position of a frame in its group's sweep; equal positions are the same frame at different levels
truth_table: Columns of truth.parquet and truth.csv, and their writers
"""
