"""OpenCV's calibration, and the chessboard as a reference.

camera_errors: What a calibration is worth against the true camera
chessboard: The chessboard: its corners in an image, and its pose
chessboard_reference: The chessboard as a second witness: the pose of a circle from the board printed beside it, by
    `cv2.solvePnP`
opencv: Calibration from chessboard views by OpenCV
study_calibrations: Several calibrations of one camera, from few views and from many, each judged against the truth
"""
