"""Settings for all tests."""

from hypothesis import settings

# derandomize: a red run must be red for everyone, every time. No deadline: the first call of a
# function pays for imports and just-in-time compilation, and shared machines stall.
settings.register_profile("roundel", derandomize=True, deadline=None)
settings.load_profile("roundel")
