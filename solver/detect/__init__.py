"""An image to detections, each with a confidence.

arcs: Cut edge segments at corners, to keep the visible arcs of a circle that is partly hidden or crossed by a
    shadow
blob: The ellipse of a small blob from its grey-level moments; chains of whole pixels are too coarse at this size
candidates: Candidate ellipses: those that EdgeDrawing finds, and those fitted to its edge segments
confidence: Confidence that a contour is the image of a circle, and the threshold below which it is not reported
detect: Detect the circles of an image: candidates, evidence along their contours, one detection for each marker
evidence: Contrast across the contours of many candidate ellipses at once: is there an edge all the way round?
pyramid: Image pyramid: images reduced by whole factors, and detections scaled back to full resolution
"""
