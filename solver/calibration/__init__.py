"""Calibration of a camera from circle grids, by the contours of their circles.

bundle: Bundle adjustment of a camera and the poses of its boards, from ellipses with covariance
calibrate_images: Calibration from images of a circle grid: arrays, photographs, or the frames of a dataset
contour_model: Predicted images of a board's circles, and their derivatives by camera, board pose and dot diameter
first_camera: A first camera from the homographies of a plane, for the bundle adjustment to start from
fitted_ellipse: The ellipse that a least-squares fit finds on a contour that is not quite one, and its derivative
grid_calibration: Calibration of a camera from views of a circle grid, without the bias of circle centres
grid_image: The dots of a circle grid in one image: detected, ordered, and fitted to the pixels
grid_layout: A circle grid as a calibration sees it: its dots in the board's frame
lattice: Order of a grid's dots in an image: neighbours by the dots' own shapes, then the lattice that they span
"""
