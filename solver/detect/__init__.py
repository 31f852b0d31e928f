"""An image to detections, each with a confidence.

arcs: Cut edge chains at corners, to keep the visible arcs of a circle that is partly hidden or crossed by a shadow
blob: The ellipse of a small blob from its grey-level moments; chains of whole pixels are too coarse at this size
candidates: Candidate ellipses: fitted to edge chains or to their arcs, and extended along the edges that continue
    them
chessboard_corners: Corners of a chessboard: found by OpenCV, then ordered and refined
concentric: Which contours are concentric circles in one plane: the edges of rings, whose outermost is the marker's
confidence: Confidence that a contour is the image of a circle, and the threshold below which it is not reported
contours: From candidate ellipses to contours: the strongest evidence first, each contour measured once
detect: Detect the circles of an image: candidates, evidence along their contours, one detection for each marker
distinct: Which ellipses are the same contour, found by a grid of their centres instead of by comparing all pairs
edge_chains: The edges of a grey image as chains of neighbouring pixels, by OpenCV's EdgeDrawing
ellipse_sums: An ellipse from sums over points: Halir and Flusser's direct fit in closed form, for thousands of arcs
evidence: Evidence for many candidate ellipses at once: is there an edge all the way round, and where exactly?
grey_image: The noise of an image, and its 8-bit version for detectors that accept nothing else
light_slope: The slope of the light beside a contour: a step that is no steeper than its surroundings is no edge
pyramid: Image pyramid: images reduced by whole factors, and detections scaled back to full resolution
quad_edges: Corners of a dark quadrilateral as intersections of the lines through its four edges, with their
    covariance
"""
