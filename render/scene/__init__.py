"""A frame as a Mitsuba scene: ink, materials, lights.

ink: The ink plugin: a Mitsuba texture that evaluates a sheet's shapes analytically, ray by ray
ink_shapes: Coverage of ink and the lattices of grain and clutter, traced by Dr.Jit in float32
light_map: Environment maps: an OpenEXR file to a Mitsuba emitter, decoded once and kept from frame to frame
lights: The lights of a frame as Mitsuba emitters: constant environment, map, sun and sky, lamps
materials: What light falls on, for Mitsuba: the print under its gloss, and the things that stand before it
scene: A frame as a Mitsuba scene: one plane that carries sheet and wall, lights, and what stands before the print
transport: Light on a plain sheet, in closed form: no search for what a ray meets, and no noise but the lamps' own
"""
