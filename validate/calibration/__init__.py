"""OpenCV's calibration, and the chessboard as a reference.

camera_errors: Errors of a calibrated camera against the true one
chessboard: Chessboard detection and pose: corners by OpenCV, then ordered and refined
chessboard_reference: Reference pose from the chessboard: the pose of a circle from the board printed beside it, by
    `cv2.solvePnP`
opencv: Camera calibration from chessboard views by OpenCV, blind to the truth
study_calibrations: Calibrations of one camera from different numbers of views, each judged against the truth
"""
