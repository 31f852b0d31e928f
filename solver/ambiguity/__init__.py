"""Which of the two poses: declared knowledge and cues to probabilities.

concentric_circle: A circle about the marker's centre as evidence: a centre dot, the inner edge of a ring
disambiguation: Which of the two poses is the true one: only what is known from elsewhere can tell
normal_prior: What is known of the normal: a direction, or a plane it lies in, each with its spread
observation: What one detection offers to those who choose between its two poses, and what each of them answers
parse_prior: Knowledge in words, as the command line and a study's `solve.knowledge` give it
pattern_cue: A known print inside the circle as evidence: seen through both poses, over all turns in the plane
pattern_prediction: A print as one pose predicts it in the pixels, and how the prediction moves with all that is
    uncertain
vanishing_line_side: The paper's condition as knowledge, and how far it can be trusted
viewing_cone: The cone over an ellipse, its two circular sections, and how both move with all that is uncertain
"""
