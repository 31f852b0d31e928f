"""The paper's claims as verdicts, the benefit of a calibration, robustness.

calibration_benefit: Is it worth calibrating the camera? Errors with a calibration beside those without, on the same
    frames
calibration_benefit_text: The answer to the paper's question in words and in numbers: where a calibration is worth
    having, and by how much
claim: A claim before it is decided: its text, the statistics that speak for or against it, and its known conditions
conditions: What the paper's claims are decided on: errors by group, on or off the optical axis, for each kind of
    intrinsics
normal: The paper's claims about the normal: worse with distance, worst at low tilt, the same whatever the focal
    length
position: The paper's claims about the position: calibrated it ignores the distance, uncalibrated it is linear in it
reprojection: The paper's claims about reprojection: calibrated it grows with distance, uncalibrated it falls and
    meets it
robustness: A study that repeats the same frames at several levels of one nuisance: error over level, and where it
    doubles
verdicts: The paper's claims as verdicts: each decided on a report's own frames, with its statistic, and written in
    words
"""
