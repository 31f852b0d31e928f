"""Images to poses, blind to the truth."""
