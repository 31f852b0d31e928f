"""The `roundel` command: arguments, progress, exit codes; no numerics."""
