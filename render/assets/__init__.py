"""Files that users bring along, as Mitsuba objects.

decoding: Decode pictures on two threads at least
meshes: Meshes of a user's scene as Mitsuba shapes, loaded once and moved for each frame
picture: A picture on the wall behind the sheet, as a Mitsuba shape
xml_scene: A Mitsuba XML scene, loaded once and moved for each frame
"""
