"""The processor that kernels are compiled for. The last bits of a pressure depend on it."""

from __future__ import annotations

import os
import platform
from functools import lru_cache

#: instructions that change how products are rounded, or how many numbers are added at once
_FEATURES = ("fma", "avx2", "avx512f", "neon", "sve")


@lru_cache(maxsize=1)
def processor() -> str:
    """Name of the processor, and those of its instructions on which the last bits depend, in one line."""
    if name := os.environ.get("NUMBA_CPU_NAME"):
        return f"{name} (NUMBA_CPU_NAME)"
    try:
        from llvmlite import binding

        there = binding.get_host_cpu_features()
        features = [feature for feature in _FEATURES if there.get(feature)]
        return f"{binding.get_host_cpu_name()} ({', '.join(features) or 'none of ' + ', '.join(_FEATURES)})"
    except (ImportError, RuntimeError, OSError):
        return platform.machine()
