"""A frame: all values drawn, all objects placed.

cameras: Camera and motion of a frame, from sections of a study whose spreads are drawn
frame: Frame i of a study, a pure function of (study, i): all values drawn, all objects placed
lamps: Geometry of lamps, shared by renderer and truth
occluders: Flat occluders in front of the print: what they hide from the camera, in closed form
sheets: From a marker's section to the printed sheet: one function for each kind
"""
