"""Systems that the paper builds on or competes with, a module for each, named by author and year.

chen2004: Chen: focal length, normal and centres from two or more coplanar circles, by a search over the focal
    length
circles_of_view: Circles of a view, as conics with covariance: what methods of several circles start from
dual_circular_points: Identities between a circle's image, its centre, the vanishing line, the circular points and
    the focal length
gurdjos2006: Gurdjos: two or more parallel circles give the image of the circular points, by the pencils of their
    conics
huang2015: Huang: common self-polar triangles of two concentric circles in three or more views give the calibration
    matrix
kim2005: Kim: two concentric circles give the image of their centre, the vanishing line, and the focal length
opencv_centres: OpenCV's blob and grid detectors as plug-ins that return centres only, written as a third party
    would write them
plane_of_view: From the circles of a view to its answers: which are printed, the focal length of their plane, a pose
    of each
pollefeys1999: Pollefeys: three or more views give the calibration of each by the absolute dual quadric
szpak2015: Szpak: an ellipse that is one by construction, with its covariance and the confidence band of its contour
wu2004: Wu: both normals of a circle's plane from its image and a known camera; two circles of one view choose
"""
