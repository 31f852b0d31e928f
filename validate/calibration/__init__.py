"""OpenCV's calibration, and the chessboard as a reference.

board_bundle: Bundle adjustment of a camera and the poses of its boards, from corners, with covariance
camera_errors: Errors of a calibrated camera against the true one
chessboard: Pose of a chessboard from its corners, as the reference of a camera: the better of both poses of its
    plane
chessboard_reference: Reference pose from the chessboard: the pose of a circle from the board printed beside it, by
    `cv2.solvePnP`
opencv: Camera calibration from chessboard views by OpenCV, blind to the truth
study_calibrations: Calibrations of one camera from different numbers of views, each judged against the truth
"""
