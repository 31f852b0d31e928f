"""Radiance to digital numbers: glare, electrons, mosaic, curve, processing, encoding.

curve: Digital numbers of the file: white balance, curve, processing, and bit depth
data_sheet: Data sheet of a sensor: the section of a study with all values drawn
demosaic: Bayer mosaics: the filter of each pixel, and bilinear interpolation
develop: From linear radiance to the delivered image: glare, exposure, sensor, colours, curve, processing
encode: Image files as bytes: PNG or JPEG
exposure: Exposure, for the sheet's white or as set by the study, and white balance
glare: Veiling glare and halo: light that the lens scatters over the image, in linear radiance before exposure
isp: The camera's image signal processor, on levels after the curve: denoising, tone, saturation, sharpening
photometry: Noise of a pixel and contrast of a marker's edge, in digital numbers
sensor: Radiance to digital numbers: photons, electrons, DN (EMVA 1288 release 4.0, linear camera model)
"""
