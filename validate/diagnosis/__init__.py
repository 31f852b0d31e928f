"""Estimates that are right but for a convention: units, axes, frame numbers, pixels.

conventions: Conventions that files of estimates have by mistake, each as the change of the table that undoes it
diagnosis: Which other convention makes the estimates of a file fit, and by how much
fit: How well estimates fit the true circles: the distance of the nearest contour, circle by circle
"""
