"""Settings for all tests."""

import pytest
from hypothesis import settings

# derandomize: a red run must be red for everyone, every time. No deadline: the first call of a
# function pays for imports and just-in-time compilation, and shared machines stall.
settings.register_profile("roundel", derandomize=True, deadline=None)
settings.load_profile("roundel")


@pytest.fixture
def mi():
    """Mitsuba, started on the default variant."""
    from roundel.render.backend import start

    return start()


@pytest.fixture
def rgb():
    """Mitsuba on a variant with colours; the default one again for whoever comes next."""
    from roundel.render.backend import start

    yield start("llvm_ad_rgb")
    start()
