"""Points, planes and circles under projection; no camera model, no study.

conic: Conics: the image of a circle, its ellipse, the image of its centre, and the second pose
edge_spread_function: Edge spread function of a square pixel with Gaussian blur, in closed form
information: Fisher information of a circle's pose in points of its contour, or in that about the shape of its ellipse
pixel_information: Fisher information of an ellipse's shape in the pixels about its contour
pose: Poses: normals from tilt and azimuth, rotations, and rigid transforms named by their frames
"""
