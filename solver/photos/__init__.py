"""Photographs and videos: reading, solving, overlays.

file_curve: The response curve that an image file declares: its ICC profile, or a PNG's gAMA and sRGB chunks
heif_file: HEIC and HEIF: the container and codec in which iPhones and many other phones save photographs
overlay: Draw estimates on a photograph: contour, centre, both normals, and the distance with its standard deviation
photo_file: Read a photograph: upright, grey, in linear light, with its EXIF tags
photo_inputs: Which photographs are meant: files, folders, patterns, and the pages of a TIFF
photo_report: Results of photographs as text: `estimates.json`, and one line each for the terminal
photo_table: `estimates.csv`: the results of photographs as a table for spreadsheets
photographs: Solve photographs: each with its own focal length, into tables, a readable record and pictures
raw_file: Raw files (DNG and those of the camera makers), in linear light, if `rawpy` is installed
video: Solve a video: the markers of all its frames with their identities, into a table and an overlay video
video_file: The frames of a video file, by OpenCV's decoder, and what went wrong, in one line
video_overlay: A video's frame with its tracked markers: contour, normals, identity, and what is not certain, in words
"""
