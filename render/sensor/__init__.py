"""Radiance to digital numbers: electrons, curve, mosaic, encoding.

curve: Digital numbers of the file: white balance, tone curve, and bit depth
data_sheet: Data sheet of a sensor: the section of a study with all values drawn
demosaic: Bayer mosaics: the filter of each pixel, and bilinear interpolation
develop: From linear radiance to the delivered image: exposure, sensor, colours, curve
encode: Image files as bytes: PNG or JPEG
exposure: Exposure, for the sheet's white or as set by the study, and white balance
photometry: Noise of a pixel and contrast of a marker's edge, in digital numbers
sensor: Radiance to digital numbers: photons, electrons, DN (EMVA 1288 release 4.0, linear camera model)
"""
