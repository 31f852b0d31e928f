"""The paper's theory in corrected form; no command needs it.

conic_pencil: The pencil of a circle's image C and the image of the absolute conic, omega = K^-T K^-1: the paper's
    framework
homography: The homography from the plane of a circle to the image, from the circle's image and the vanishing line
    alone
propositions: Which of the two lines is the vanishing line: the separation test of propositions 1 to 3, in image and
    plane
"""
