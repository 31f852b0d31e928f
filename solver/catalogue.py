"""The methods that come with Roundel: its own fits, and others with their markers, what they return, their papers."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Listed:
    """A method of the catalogue.

    Attributes
    ----------
    name, at : str
        Its name, and its callable as `module:function`.
    markers : tuple of str
        The kinds of marker that it reads, as in a study.
    about, returns, paper : str
        What it is, what it returns, and its source.
    """

    name: str
    at: str
    markers: tuple[str, ...]
    about: str
    returns: str
    paper: str = ""


# Fits of Roundel's own, see `roundel_fits`.
FITS = {
    "pixels": "ellipse, blur and grey levels fitted to the pixels themselves",
    "ml": "orthogonal distances of edge points",
    "guaranteed": "Sampson distances of edge points, an ellipse by construction (Szpak et al. 2015)",
    "direct": "algebraic distances of edge points (Halir and Flusser 1998)",
    "edgedrawing": "ellipse by OpenCV's EdgeDrawing",
}


def _related(name: str, markers: str, about: str, returns: str, paper: str) -> Listed:
    return Listed(name, f"roundel.solver.related.{name}:find", tuple(markers.split()), about, returns, paper)


CATALOGUE: tuple[Listed, ...] = (
    Listed(
        "blobs",
        "roundel.solver.related.opencv_centres:blobs",
        ("disc",),
        "dark blobs by cv2.SimpleBlobDetector",
        "centres",
    ),
    Listed(
        "circles_grid",
        "roundel.solver.related.opencv_centres:circles_grid",
        ("circle_grid",),
        "a grid of dots by cv2.findCirclesGrid",
        "centres",
    ),
    Listed(
        "circle_grid_pose",
        "roundel.solver.related.opencv_centres:circle_grid_pose",
        ("circle_grid",),
        "a grid of dots by cv2.findCirclesGrid and cv2.solvePnP",
        "pose",
    ),
    _related(
        "wu2004",
        "disc ring rings coded_rings ring_code two_discs dot_ring",
        "both normals of a circle; of two or more, the most parallel",
        "poses",
        "Wu, Chen, Wada, Conic-based algorithm for visual line estimation from one image, FG 2004",
    ),
    _related(
        "chen2004",
        "two_discs dot_ring",
        "two or more coplanar circles: a search over the focal length, then a fit",
        "focal length, poses",
        "Chen, Wu, Wada, Camera calibration with two arbitrary coplanar circles, ECCV 2004",
    ),
    _related(
        "kim2005",
        "ring rings coded_rings ring_code",
        "two concentric circles: centre, vanishing line, then a joint fit",
        "focal length, pose",
        "Kim, Gurdjos, Kweon, Geometric and algebraic constraints of projected concentric circles, PAMI 27(4) 2005",
    ),
    _related(
        "gurdjos2006",
        "two_discs dot_ring",
        "two or more parallel circles: the circular points from their pencils",
        "focal length, poses",
        "Gurdjos, Sturm, Wu, Euclidean structure from N >= 2 parallel circles, ECCV 2006",
    ),
    _related(
        "huang2015",
        "ring rings coded_rings ring_code",
        "two concentric circles in three views or more: common self-polar triangles, then a joint fit",
        "focal length, pose",
        "Huang, Zhang, Cheung, The common self-polar triangle of concentric circles, CVPR 2015",
    ),
    _related(
        "pollefeys1999",
        "dot_ring",
        "a plane of dots in three views or more: what it shows of the absolute dual quadric",
        "focal length, poses",
        "Pollefeys, Koch, Van Gool, Self-calibration and metric reconstruction, IJCV 32(1) 1999",
    ),
    _related(
        "calvet2016",
        "ring_code",
        "coded crowns: the image of the centre by cuts that agree, then a fit of all pixels",
        "identity, focal length, pose",
        "Calvet, Gurdjos, Griwodz, Gasparini, Detection and accurate localization of circular fiducials, CVPR 2016",
    ),
    _related(
        "bergamasco2011",
        "dot_code",
        "dots on rings: votes of pairs, a cyclic code, then a fit of all pixels",
        "identity, focal length, pose",
        "Bergamasco, Albarelli, Rodola, Torsello, RUNE-Tag: a high accuracy fiducial marker, CVPR 2011",
    ),
    _related(
        "pagani2011",
        "ring rings ring_code coded_rings disc_with_tick",
        "a circle rectified with both poses, compared with the expected print",
        "pose, identity",
        "Pagani, Koehler, Stricker, Circular markers for camera pose estimation, WIAMIS 2011",
    ),
    _related(
        "szpak2015",
        "disc ring rings coded_rings ring_code two_discs dot_ring",
        "guaranteed ellipse of the edge points, by Sampson distances",
        "ellipses, both poses",
        "Szpak, Chojnacki, van den Hengel, Guaranteed ellipse fitting with a confidence region, JMIV 52, 2015",
    ),
    _related(
        "chessboard",
        "chessboard disc_with_chessboard",
        "a chessboard by cv2.findChessboardCornersSB",
        "both poses, focal length",
        "Zhang 2000; Duda and Frese 2018",
    ),
    _related(
        "fiala2010",
        "tags",
        "square tags by cv2.aruco: ArUco and AprilTag, edges refined below the pixel",
        "both poses, identity, focal length",
        "Fiala 2010",
    ),
)


def is_own(name: str) -> bool:
    """Whether a method comes with Roundel."""
    return name in FITS or listed(name) is not None


def listed(name: str) -> Listed | None:
    """The entry of a name; None if it is not in the catalogue."""
    return next((entry for entry in CATALOGUE if entry.name == name), None)
