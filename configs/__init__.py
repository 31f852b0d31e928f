"""Studies in YAML that ship with Roundel."""
