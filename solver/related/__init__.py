"""Systems that the paper builds on or competes with, a module for each, named by author and year.

circles_of_view: Circles of a view, as conics with covariance: what methods of several circles start from
"""
