"""Files that users bring along: meshes, Mitsuba scenes, textures and pictures, checked before anything is rendered.

anchor: Where the sheet lies in a user's scene: the pose that takes the sheet's frame to the scene's
files: Files that a study brings along: they lie inside its folder, are of bounded size, and are known by their
    sha256
light_map: Check an environment-map file: it exists, is OpenEXR or Radiance HDR within the size limit, and matches
    its recorded checksum
meshes: Meshes of a user's scene: glTF, GLB, OBJ and PLY, read by trimesh into plain arrays
mitsuba_xml: A Mitsuba XML scene before Mitsuba sees it: only known elements, plugins and files inside the study's
    folder pass
pictures: Textures and pictures: PNG and JPEG files, checked by their headers, decoded to linear light by Pillow
references: Files that a mesh file refers to: buffers and images of glTF, materials and textures of OBJ
visibility: What of a user's meshes is between the camera and the marker, by rays against triangles in float64
"""
