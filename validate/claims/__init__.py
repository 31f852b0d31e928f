"""The paper's claims as verdicts, the benefit of a calibration, robustness.

benefit_over_cameras: Benefit of a calibration over several cameras: each report is one camera, each calibration of
    it one set of views
calibration_benefit: Benefit of a calibration: errors with and without it on the same frames
calibration_benefit_text: Summary text and record of the benefit of a calibration
claim: A claim of the paper with its findings, before the decision
conditions: Experimental conditions of the claims: errors by group, on or off the axis, for each kind of intrinsics
normal: Claims about the normal: its error grows with distance, is worst at low tilt, ignores the focal length
position: Claims about the position: independent of distance if calibrated, linear in it if not
reprojection: Claims about reprojection: it grows with distance if calibrated, falls if not, and the two meet
robustness: Error over the levels of one nuisance, on the same frames, and the level at which it doubles
verdicts: Verdicts on the paper's claims, decided on a report's own frames
"""
