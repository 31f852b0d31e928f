"""ringgrid (0.13): rings with a code of 16 sectors; outer ellipse, projective centre and identity of each."""

from __future__ import annotations

from typing import Any

import numpy as np
import ringgrid

from roundel.solver.methods.plugin import Found, MethodFailure, View
from roundel_peers.frames import printed, straight

SECTORS = 16


def find(view: View) -> list[Found]:
    """Ellipses, centres and identities of coded rings."""
    marker = printed(view, "coded_rings")[0]
    layout = marker["layout"]
    if len(layout["code"]) != 1 or len(layout["code"][0]) != SECTORS or "hole" not in layout:
        raise MethodFailure("it reads one ring of 16 cells between two rings; the printed rings are others")
    # A single marker of unknown size: its search over sizes, which `detect` leaves to the user.
    result = _detector(layout).detect_adaptive(straight(view))
    return [_found(one) for one in result.detected_markers if one.ellipse_outer is not None]


def _detector(layout: dict[str, Any]) -> ringgrid.Detector:
    """A detector of single rings: no board, so nothing is inferred from neighbours."""
    outer = 10.0  # mm; only ratios matter
    width = outer * (1 - layout["ring_from"])
    geometry = ringgrid.RingGeometry(outer - width / 2, outer * layout["hole"] + width / 2)
    coding = ringgrid.Coded16(width)
    # As many places as the codebook has identities: it accepts only identities of its layout.
    lattice = ringgrid.RectGeometry(19, 47, 3 * outer)
    config = ringgrid.DetectConfig(ringgrid.TargetLayout("single", lattice, geometry, coding))
    config.use_global_filter = config.completion_enable = False
    correction = config.id_correction
    correction.enable = False
    config.id_correction = correction
    return ringgrid.Detector(config)


def _found(one: ringgrid.DetectedMarker) -> Found:
    e = one.ellipse_outer
    a, b, angle = (e.a, e.b, e.angle) if e.a >= e.b else (e.b, e.a, e.angle + np.pi / 2)
    return Found(
        ellipse=[e.cx, e.cy, a, b, np.degrees(angle) % 180],
        centre_px=one.center,
        confidence=float(np.clip(one.confidence, 0, 1)),
        identity=None if one.id is None else int(one.id),
    )
