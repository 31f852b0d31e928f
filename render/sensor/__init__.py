"""Radiance to digital numbers: electrons, curve, mosaic, encoding.

curve: The delivered numbers: from the converter's by white balance, a curve and the bits of the file
data_sheet: A sensor as its data sheet would describe it: what a section of a study, with all numbers drawn, comes
    to
demosaic: Bayer mosaics: which pixel has which filter, and colours interpolated between them
develop: From linear radiance to the image that is delivered: exposure, sensor, colours, curve; with what is known
    of it
encode: An image as the bytes of its file: PNG without loss, or JPEG
exposure: How long to expose: on the sheet's white, or as the study says; and what makes that white grey
photometry: The noise a pixel truly has, and the contrast of a marker's edge, in the numbers of the file
sensor: Radiance to the converter's numbers: photons, electrons, DN (EMVA 1288 release 4.0, linear camera model)
"""
