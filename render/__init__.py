"""Mitsuba 3: a frame to radiance, radiance to digital numbers."""
