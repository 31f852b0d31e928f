"""The 35 mm frame to which EXIF's equivalent focal length refers, and the default focal lengths of a phone."""

from __future__ import annotations

import math

# Diagonal of the 36 mm x 24 mm frame, to which EXIF's 35 mm equivalent refers (CIPA DCG-001).
FILM_DIAGONAL_MM = math.hypot(36.0, 24.0)

# Mean and standard deviation of phones' 35 mm equivalent focal lengths (the paper's section IV-C; errata, section 4).
DEFAULT_FOCAL_35MM_MM = 29.95
DEFAULT_FOCAL_35MM_SIGMA_MM = 3.444  # 11.5 %

# The same of the main cameras of phones of 2020 and later: the fit to `phones.csv`, rounded (a test holds them to it).
FOCAL_35MM_2020S_MM = 24.84
FOCAL_35MM_2020S_SIGMA_MM = 2.05  # 8.3 %
