"""The paper's theory in corrected form: functions for study and for scripts, which no command calls (docs/theory.md).

conic_pencil: The pencil of a circle's image and the image of the absolute conic, omega = K^-T K^-1: the paper's
    framework
curvature_bias: Correction of the orthogonal-distance fit for its bias under isotropic noise
homography: The homography of a circle's plane, from the circle's image and the vanishing line alone
pose_region: Confidence regions of the normal and of the centre, from the covariance of a pose
propositions: Propositions 1 to 3: the separation test for the vanishing line, in the image and in the plane
"""
