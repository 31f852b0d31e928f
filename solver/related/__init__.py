"""Systems that the paper builds on or competes with, a module for each, named by author and year.

bergamasco2011: Dots on rings (RUNE-Tag): identity by a cyclic code, pose by the dots' centres, focal length if it
    is not known
calvet2016: Coded crowns (CCTag): identity, image of the centre, unique pose and focal length from one marker
chen2004: Chen: focal length, normal and centres from two or more coplanar circles, by a search over the focal
    length
chessboard: The chessboard, which the paper takes as its reference, as a method: pose and focal length from one view
    of a board
fiala2010: Square tags with a binary code: Fiala, Designing Highly Reliable Fiducial Markers (2010), by OpenCV's
    ArUco module
gurdjos2006: Gurdjos: two or more parallel circles give the image of the circular points, by the pencils of their
    conics
huang2015: Huang: common self-polar triangles of two concentric circles in three or more views give the calibration
    matrix
kim2005: Kim: two concentric circles give the image of their centre, the vanishing line, and the focal length
opencv_centres: OpenCV's blob and grid detectors as plug-ins, written as a third party would: centres, or the pose
    of a grid
pagani2011: A known print tells which of the two poses of a circle is the true one
pollefeys1999: Pollefeys: three or more views give the calibration of each by the absolute dual quadric
szpak2015: Szpak: an ellipse that is one by construction, with its covariance and the confidence band of its contour
wu2004: Wu: both normals of a circle's plane from its image and a known camera; two circles of one view choose
"""
