"""Systems that the paper builds on or competes with, a module for each, named by author and year.

circles_of_view: Circles of a view, as conics with covariance: what methods of several circles start from
opencv_centres: OpenCV's blob and grid detectors as plug-ins that return centres only, written as a third party
    would write them
"""
