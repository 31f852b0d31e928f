"""Entries of the league: a method with its prior knowledge, and the variants of the study whose markers it reads."""

from __future__ import annotations

from dataclasses import dataclass

# The variants of configs/league.yaml with a circle that Roundel's own methods find.
CIRCLES = ("disc", "ring", "coded_rings", "ring_code", "ringgrid")


@dataclass(frozen=True)
class Entry:
    """An entry of the league.

    Attributes
    ----------
    name : str
        As in the tables.
    method : str
        See `roundel solve --list-methods`.
    variants : tuple of str
        Variants of the study on which it runs.
    about : str
        Marker and method in a few words.
    knowledge : str
        Prior knowledge of the pose, as `roundel solve --knowledge`.
    """

    name: str
    method: str
    variants: tuple[str, ...]
    about: str
    knowledge: str = "none"


# Roundel's and OpenCV's; methods that are not installed are left out.
ENTRIES: tuple[Entry, ...] = (
    Entry("pixels", "pixels", CIRCLES, "Roundel: one circle, both poses"),
    Entry("pixels, coplanar", "pixels", ("two_discs", "dot_ring"), "Roundel: all circles on one plane", "coplanar"),
    Entry("pixels, ring", "pixels", ("ring",), "Roundel: the inner circle decides", "circle:0.5"),
    Entry("edgedrawing", "edgedrawing", ("disc", "ring"), "OpenCV's EdgeDrawing, Roundel's poses"),
    Entry("blobs", "blobs", ("disc",), "OpenCV's SimpleBlobDetector, centres"),
    Entry("wu2004", "wu2004", ("disc", "two_discs"), "one circle; two choose the most parallel pair"),
    Entry("chen2004", "chen2004", ("two_discs", "dot_ring"), "coplanar circles"),
    Entry("kim2005", "kim2005", ("ring",), "concentric circles"),
    Entry("gurdjos2006", "gurdjos2006", ("two_discs", "dot_ring"), "parallel circles, the pencil"),
    Entry("huang2015", "huang2015", ("ring",), "concentric circles in several views"),
    Entry("calvet2016", "calvet2016", ("ring_code",), "coded concentric rings, centred photometrically"),
    Entry("bergamasco2011", "bergamasco2011", ("dot_code",), "coded dots on rings"),
    Entry("pagani2011", "pagani2011", ("coded_rings", "ring_code"), "both rectifications against the pattern"),
    Entry("fiala2010", "fiala2010", ("aruco", "apriltag"), "square tags by cv2.aruco and IPPE"),
    Entry("szpak2015", "szpak2015", ("disc",), "guaranteed ellipse fit"),
    Entry("pollefeys1999", "pollefeys1999", ("dot_ring",), "absolute dual quadric of several views"),
    Entry("chessboard", "chessboard", ("chessboard",), "findChessboardCornersSB and solvePnP"),
    Entry("circle_grid_pose", "circle_grid_pose", ("circle_grid",), "cv2.findCirclesGrid and solvePnP"),
    Entry("simittag", "simittag", ("coded_rings",), "published program: coded rings"),
    Entry("pupil_apriltags", "pupil_apriltags", ("apriltag",), "published program: AprilTag 3"),
    Entry("ringgrid", "ringgrid", ("ringgrid",), "published program: coded ring boards"),
    Entry("stag", "stag", ("stag",), "published program: STag"),
    Entry("pycalib", "pycalib", ("disc",), "published program: closed-form poses of an algebraic ellipse"),
)
