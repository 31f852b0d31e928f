"""The files of a dataset: names, formats, the write protocol.

files: The write protocol, and the names of a dataset's files
images: Images and cameras of a dataset: all that a solver may open
journal: The journal: one line a finished frame, appended when its files are safe; a frame is done when both agree
manifest: The manifest of a dataset: read, and refused where it is not one
radiance: Linear radiance on disk: OpenEXR, float32, with its Monte-Carlo variance beside it
truth_table: truth.parquet and truth.csv: the columns, in order, and their writers
"""
