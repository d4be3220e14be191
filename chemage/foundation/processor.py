"""The processor that kernels are compiled for, and whether numpy uses AVX-512. The last bits of a pressure depend on both."""

from __future__ import annotations

import os
import platform
from functools import lru_cache

#: instructions that change how products are rounded, or how many numbers are added at once
_FEATURES = ("fma", "avx2", "avx512f", "neon", "sve")


#: numpy's names of AVX-512, from 2.4 on and before, in ``NPY_DISABLE_CPU_FEATURES``
_OF_NUMPY = {"X86_V4", "AVX512_SKX"}


@lru_cache(maxsize=1)
def processor() -> str:
    """Name of the processor, and those of its instructions on which the last bits depend, in one line."""
    named = os.environ.get("NUMBA_CPU_NAME")
    try:
        from llvmlite import binding

        there, host = binding.get_host_cpu_features(), binding.get_host_cpu_name()
    except (ImportError, RuntimeError, OSError):
        return f"{named} (NUMBA_CPU_NAME)" if named else platform.machine()
    wide = bool(there.get("avx512f"))
    in_numpy = wide and not _OF_NUMPY & set(os.environ.get("NPY_DISABLE_CPU_FEATURES", "").replace(",", " ").split())
    if named:
        return f"{named} (NUMBA_CPU_NAME{', numpy with AVX-512' * in_numpy})"
    features = [feature for feature in _FEATURES if there.get(feature)]
    less = ", numpy without AVX-512" * (wide and not in_numpy)
    return f"{host} ({', '.join(features) or 'none of ' + ', '.join(_FEATURES)}{less})"
