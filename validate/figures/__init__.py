"""The figures of a report.

calibration: Figures of calibrations: where in the image each of them is wrong, and how little its residual says
    about that
calibration_benefit: The report's first figure: errors with and without calibration over distance, tilt and offset
    from the axis
error_curves: Figures as SVG: the paper's figure from a table of scores
errors_by_variable: Each degree of freedom against each error: a matrix of small plots, one figure for the run that
    a report leads with
overlays: The worst frames, to look at: a crop of the image with the true contour and the estimated ellipse drawn
    over it
robustness: Figures of sweeps: error over the level of a nuisance, with its interval, its bound, and where it
    doubles
side_by_side: Runs side by side: a figure of their errors, and what differs on the frames that two of them share
svg: How every figure is drawn: matplotlib's SVG, inlined into the page that shows it and coloured by it
verdict_curves: Parts of the verdicts' figures: curves of means with their intervals, laws beside them, axes and
    panels
verdicts: The figure of each verdict: means with 95 % intervals by distance, one panel a setting, and the law beside
    them
writers: Figures as files beside the report: the SVG of the page, which follows the reader's light or dark by itself
"""
