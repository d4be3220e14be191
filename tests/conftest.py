"""What all tests share."""

from __future__ import annotations

from hypothesis import HealthCheck, settings

from chemage.testing import isolated_registry as isolated_registry

# the same examples on every run: a test that fails does so for everyone, and one that passes stays passed
settings.register_profile(
    "chemage", derandomize=True, deadline=None, max_examples=60, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("chemage")
