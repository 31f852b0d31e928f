"""Methods by name, Roundel's and third-party, and the chain from an image to estimates.

companions: The other images by the camera of a frame, for methods that need several views
compilation_shares: What other processes compile at the first compilation: they run the fits of a drawn disc
estimate_caveats: Caveats of an estimate: numbers and sentences about how well its model holds, from its fit and its
    image
fit_poses: Both poses, with covariance, of the ellipses that were fitted in a frame, all at once
locate: `locate`: the circles of one image, given as an array, with both poses of each
method_file: A method in a Python file of the user: `path/to/file.py:function`, without a package or an entry point
plugin: The plug-in interface for third-party methods: `View` in, `Found` out, and its checks (docs/your-own-
    method.md)
pose_estimate: The `Estimate` of one fitted ellipse: both poses, covariance, and the choice between them
registry: All methods by name: Roundel's own, files (see `method_file`), and plug-ins from the entry points
    `roundel.methods`
roundel_fits: Roundel's own methods: the ellipse of a detection, by one of five fits
shutter_motion: The motion of detections during the readout of its camera, as the fits take it
solve: Solve a dataset: every frame with every method and every intrinsics label, into one file
solve_image: The chain for one frame: detect, fit, pose, choose; arrays, datasets and photographs all use it
solve_together: Estimates of the circles of an image after `coplanar`: one plane for all, one candidate chosen, a focal
    length
solved_parts: Results of blocks of frames as they come: parts on disk, joined into the final files at the end
worker_start: What solving in several processes takes: compiled kernels, one thread each, and arguments that can be
    sent
"""
