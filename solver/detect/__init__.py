"""An image to detections, each with a confidence.

arcs: Edge segments cut where they turn a corner: the arcs of a circle whose rest is hidden, or that a shadow
    crosses
blob: The ellipse of a small blob from its grey levels: chains of whole pixels are too coarse for one of a few
    pixels
candidates: Places to look for circles: what EdgeDrawing calls ellipses, and those of its edge segments that are one
confidence: How sure it is that a contour is the image of a circle: one number, and below what nothing is reported
detect: Where the circles of an image are: candidates, evidence along their contours, one detection for each marker
evidence: What the pixels say about candidate ellipses, for all of them at once: is there a step across, all the way
    round?
pyramid: An image at a whole fraction of its size, and what was found there in the pixels of the whole one
"""
