"""Methods by name, ours and others', and the chain from an image to estimates.

locate: The whole chain for one image in one call: detect, fit, pose, choose
opencv_centres: OpenCV's own finders of round things, as methods: centres alone, no pose
plugin: A method of your own: what it is given, what it gives back, and how that is checked (docs/your-own-
    method.md)
pose_estimate: One fitted ellipse to a record: both poses with their covariance, the choice between them, and what
    all rests on
registry: The methods there are: Roundel's fits, its finders, and what installed packages add under
    `roundel.methods`
roundel_fits: From a detection to an ellipse, by any of the methods: each with what it is made from, and none
    silently replaced
solve: Estimates for a dataset: every frame, method and kind of intrinsics, in one file
"""
