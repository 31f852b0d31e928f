"""What stands before the camera, and the exact truth about it."""
