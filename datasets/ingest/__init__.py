"""Real photographs as a dataset without rendered truth: its poses are a reference that was measured.

photographs: Imported photographs, and their entries in cameras.json
reference_table: Columns of reference.parquet: where each pose comes from, and its covariance
sheet: The printed sheet of photographs, from a study's marker, and the study of the dataset
write: Write imported photographs as a dataset: all of it, or nothing
"""
