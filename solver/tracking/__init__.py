"""Markers of a video, frame after frame.

assignment: Which measured ellipse belongs to which track: the assignment of least total cost within each track's gate
ellipse_motion: Where the ellipse of a marker will be in the next image: a Kalman filter of its centre and shape in the
    image
normal_motion: Which of the two candidates moves like a body: evidence that accumulates from frame to frame
tracker: `Tracker`: the markers of a video or a camera, frame after frame, each with its identity
"""
