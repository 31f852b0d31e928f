"""The paper's condition as knowledge, and how far it can be trusted.

`same_side`: the limiting points lie on one side of the vanishing line (E > 0, Proposition 3 with its sign corrected),
and the true pose is the one with the larger n_z of the errata, index 0 here; `opposite_side`: index 1. That is a
conversion of external knowledge, and it is about the *true* camera: candidates that were computed with a wrong
principal point may have exchanged their order (errata, section 3, "Reliability guard").
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from roundel.solver.sighting import Sighting, Verdict
from roundel.solver.viewing_cone import viewing_cone


@dataclass(frozen=True)
class SideRule:
    """On which side of the vanishing line the limiting points are known to lie.

    Attributes
    ----------
    same : bool
        True for E > 0 (the errata's condition; (i) and (ii) of the paper suffice for it).
    """

    same: bool

    def problem(self) -> str:
        """Nothing can be wrong with it."""
        return ""

    def verdict(self, sighting: Sighting) -> Verdict:
        """Probability Phi(|g| / sigma_g) that the candidates stand in their true order.

        g = e3_z, where both normals are -cos e1 -+ sin e3: their n_z are equal just where e3 is parallel to the image,
        and that is where the principal point lies on the ellipse's axis of symmetry, m.(x_e - pp) = 0. So g f is the
        errata's offset along the minor axis, exact for large and off-axis circles as well, and sigma_g carries the
        principal point, the ellipse and the focal length together. The prior is flat: markers are not aimed at to
        within the error of the principal point.
        """
        word = "same side" if self.same else "opposite side"
        sign = 1.0 if self.same else -1.0
        cone = viewing_cone(sighting)
        if cone is None:
            return Verdict(sign * math.inf, f"{word} of the vanishing line, declared; the camera is taken as exact")
        g = float(cone.side[0, 2])
        sigma = float(np.linalg.norm(cone.spread(cone.side[:, 2])))
        z = g / sigma if sigma > 0 else math.inf
        # log(Phi(z) / Phi(-z)); beyond 8 sigma Phi(-z) is 1e-15, and 1 is what it rounds to.
        odds = math.inf if z > 8.0 else math.log(math.erfc(-z / math.sqrt(2.0)) / math.erfc(z / math.sqrt(2.0)))
        to_px = float(cone.K[0, 0, 0]) / max(float(np.hypot(*cone.side[0, :2])), 1e-12)
        trust = f"{g * to_px:.3g} px from where the order turns, which is known to {sigma * to_px:.2g} px"
        return Verdict(sign * odds, f"{word} of the vanishing line, declared; {trust}")
