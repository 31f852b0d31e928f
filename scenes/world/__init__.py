"""A frame: every number drawn, every object placed.

frame: Frame i of a study: a pure function of (study, i)
lamps: Where lamps stand and what they shine on: the geometry that renderer and truth share
occluders: Flat things before the print: what they hide from the camera, in closed form and in float64
sheets: From a marker's section of a study to the sheet that is printed: one function a kind
"""
