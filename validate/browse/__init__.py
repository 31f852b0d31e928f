"""The page of `roundel browse`: all frames of a dataset, to look at and to filter.

frames: What the page knows of frames and markers: the truth of a shard as columns of JSON
outlines: Outlines of markers in few bytes: fewer points, in hundredths of a pixel, each relative to the one before
page: `roundel browse`: a folder with a page of all frames, their true contours and, of a report, their scores
page_folder: The folder of a page: it appears complete or not at all, and replaces nothing but an earlier page
scores: The scores of a report, run by run, in the order of the page's markers
thumbnails: Thumbnails: an image of any depth as a small JPEG of 8 bits
"""
