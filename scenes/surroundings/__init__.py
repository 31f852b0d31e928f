"""What stands around the sheet in a world: its support, a room or a street, objects, materials and lights.

bodies: Bodies, materials and lights of a world as plain records: what a renderer needs to build it
gravity: Which way is up: gravity and a support for a sheet whose pose in the camera is given
objects: Objects of everyday size: boxes, books, bottles, cups, cans, balls, tools and cables, each drawn from a
    generator
places: The places: tabletop, room, shelf, workshop and outdoors, built around a sheet that stands already
posts: What holds a sheet that is bent, or that stands beside the first: a board or a can, on a post
rooms: A closed room with a window and a lamp, or the sun outdoors
sheet_place: The sheet as a world sees it: where it is, how large it is, and what of it must be seen
supports: What holds the sheet: a table, a wall, a box or a stand, and the surface below it
wall_things: What hangs on the wall beside a sheet: pictures and switches indoors; windows, pipes and plates
    outdoors
"""
