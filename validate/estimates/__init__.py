"""Files of estimates: columns, reading, defaults.

defaults: What estimates leave out, filled in from the dataset: the camera, and the ellipse of a pose
reader: Estimates from a file, our own or anyone's: Parquet or CSV, checked against the schema column by column
runs: Estimates read back and checked: a file that lies is refused in one line, before anything is scored
schema: The columns of a file of estimates: what a foreign program must give, and what stands where it gives nothing
"""
