"""The files of a dataset: names, formats, the write protocol.

files: File names of a dataset, and the write protocol
images: Images and cameras of a dataset: everything that a solver may open
journal: The journal: one line per finished frame, appended once its files are safely on disk
manifest: The manifest of a dataset, read and checked
radiance: Linear radiance on disk: OpenEXR, float32, with its Monte-Carlo variance
truth_table: Columns of truth.parquet and truth.csv, and their writers
worker_pool: Worker processes whose results come in order, for `render` and `solve`
"""
