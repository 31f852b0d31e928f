"""Files of estimates: columns, reading, defaults.

bop_results: Results in BOP's format as estimates: one pose in millimetres in each line
both_poses: Both poses of an ellipse that a file gives alone, as a Python method gets them
defaults: Defaults for columns that a file of estimates leaves out: the camera, and the ellipse of a pose
reader: Reading estimates from Parquet or CSV, checked against the schema column by column
row_checks: Rows of estimates: their values as arrays, and rows that are impossible
runs: Estimates as runs, checked for consistency before anything is scored
schema: Columns of a file of estimates: which are required, and the defaults of the others
"""
