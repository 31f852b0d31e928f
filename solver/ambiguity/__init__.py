"""Which of the two poses: declared knowledge and cues to probabilities.

concentric_circle: A concentric circle (centre dot, inner edge of a ring) as a cue for the choice between both poses
coplanar: `coplanar`: the circles of an image lie in one plane and have one size, and are solved together
disambiguation: The choice between both poses, from prior knowledge and cues
normal_prior: A prior on the normal: a direction, or a plane it lies in, each with a standard deviation
observation: One detection as priors and cues see it, and the log-likelihoods that they return
parse_prior: Parse prior knowledge from the text of `--knowledge` and of a study's `solve.knowledge`
pattern_cue: A known print inside the circle as a cue: predicted with both poses, over all in-plane rotations
pattern_prediction: The pixels of a print as one pose predicts them, with derivatives by every uncertain parameter
vanishing_line_side: The paper's same-side condition as prior knowledge, with its reliability
viewing_cone: The viewing cone of an ellipse and its two circular sections, with derivatives by every uncertain
    parameter
"""
