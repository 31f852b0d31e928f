"""A frame: all values drawn, all objects placed.

cameras: Camera and motion of a frame, from sections of a study whose spreads are drawn
frame: Frame i of a study, a pure function of (study, i): all values drawn, all objects placed
further_sheets: Further sheets of a frame: listed with their poses, or a count of them at random places where none
    hides another
lamps: Geometry of lamps, shared by renderer and truth
occluders: Flat occluders in front of the print: what they hide from the camera, in closed form
own_world: The user's own scene or pictures around the sheet: where they are, and whether the marker is seen in them
placement: Sheets in the camera frame: their pose from a study's keys, the outlines of their parts, and what must be
    in view
plausibility: Plausibility of a study: values that are legal, but look as if they were written in another unit
sheets: From a marker's section to the printed sheet: one function for each kind
"""
