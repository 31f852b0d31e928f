"""The figures of a report.

calibration: Figures of calibrations: projection error over the image, beside the residual
calibration_benefit: Figure of the benefit of a calibration: errors over distance, tilt and offset from the axis
error_curves: The paper's figure: errors over distance, a panel for each tilt
errors_by_variable: Every variable against every error: a matrix of small plots
log_ticks: Logarithmic axes with a few plain numbers as ticks, whose labels do not overlap
overlays: The worst frames: image crops with the true contour and the estimated ellipse
paired_levels: Differences between images of the same frames: levels of a sweep, or several sensors
reliability: Reliability curves: how often a statement is right, over the probability that it was given
robustness: Figures of sweeps: error over the level of a nuisance, with its interval and bound
side_by_side: Runs side by side: a figure of their errors, and paired comparisons on shared frames
svg: Drawing: matplotlib figures as SVG that is inlined into the page and coloured by its style sheet
uncertainty: Percentiles of the truth in the regions that a run states: alike in every bin if its covariance holds
verdict_curves: Parts of the verdicts' figures: curves of means with intervals, reference laws, axes and panels
verdicts: A figure for each verdict: means with 95 % intervals over distance, a panel for each condition
writers: Figures as SVG files beside the report; they follow the reader's light or dark scheme
"""
