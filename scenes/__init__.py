"""The scene in front of the camera, and the exact truth about it."""
