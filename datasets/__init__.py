"""The dataset on disk: layout, manifest, checksums, reading, verifying, exporting."""
