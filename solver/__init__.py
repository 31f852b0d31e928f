"""Images to poses, without access to the truth."""
