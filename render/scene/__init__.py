"""A frame as a Mitsuba scene: ink, materials, lights.

bodies: Bodies, panels and the sheet of a world as Mitsuba shapes
direct: Direct light on matte things: where a ray lands, each lamp is looked for once, and the uniform sky once
gloss: Gloss on a bare plane in closed form: what it reflects of a uniform sky, and of a lamp
ink: The ink plugin: a Mitsuba texture that evaluates a sheet's shapes analytically, ray by ray
ink_shapes: Coverage of ink, grain and clutter, traced by Dr.Jit in float32
light_map: Environment maps: an OpenEXR or Radiance HDR file to a Mitsuba emitter, decoded once
lights: Lights of a frame as Mitsuba emitters: constant environment, map, sun and sky, lamps
materials: Materials for Mitsuba: the print under its gloss, and the occluders
meshes: Bodies as triangles, with normals and texture coordinates at real scale
paths: Light transport in a world: paths go on in waves, from one landing to the next
scene: A frame as a Mitsuba scene: one plane with sheet and wall, lights, and occluders
sheets: Sheets as Mitsuba shapes: flat ones, bent ones, and the wall behind them
textures: Procedural textures at real scale: wood, cardboard, plaster, brick, concrete and fabric, as arrays of
    reflectance
transport: Light transport on an unoccluded sheet in closed form, without ray intersection
"""
