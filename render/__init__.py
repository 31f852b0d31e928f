"""Rendering with Mitsuba 3: from a frame to radiance, and from radiance to digital numbers."""
