"""What the whole suite shares."""

from __future__ import annotations

from hypothesis import settings

# The first example of a property may compile kernels, so that its time says nothing; the same
# examples are drawn on every machine.
settings.register_profile("visenvs", deadline=None, derandomize=True)
settings.load_profile("visenvs")
