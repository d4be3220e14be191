"""The processor that kernels are compiled for, and whether numpy uses AVX-512: both change last bits of pressures."""

from __future__ import annotations

import json
import os
import platform
import time
from contextlib import suppress
from functools import lru_cache
from pathlib import Path

from chemage.foundation import kernel_cache
from chemage.foundation.files import fresh_file

#: CPU seconds that the load of :func:`slowness` takes on a machine where the estimates of components hold
REFERENCE_SECONDS = 4.3e-3
#: of the load, and of its file
_VERSION = 1
_FILE = "chemage-speed.json"

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


@lru_cache(maxsize=1)
def slowness() -> float:
    """CPU time of a computation on this machine over that on the one for which components state their seconds.

    A load of a few milliseconds (Fourier transforms, sorting, gathering) is timed when this is first asked for, and the
    result is kept beside the compiled kernels. A file that is damaged, or of another processor, is measured again.
    """
    file = kernel_cache.folder() / _FILE
    identity = {"version": _VERSION, "processor": processor(), "node": platform.node()}
    with suppress(OSError, ValueError, TypeError, KeyError):
        kept = json.loads(file.read_text(encoding="utf-8"))
        if {name: kept[name] for name in identity} == identity and 0 < (seconds := float(kept["seconds"])) < 1:
            return seconds / REFERENCE_SECONDS
    seconds = _measured()
    with suppress(Exception):  # a folder that cannot be written is no reason to fail
        _keep(file, {**identity, "seconds": seconds})
    return seconds / REFERENCE_SECONDS


def _keep(file: Path, numbers: dict[str, object]) -> None:
    file.parent.mkdir(parents=True, exist_ok=True)
    with fresh_file(file, force=True) as part:
        part.write_text(json.dumps(numbers) + "\n", encoding="utf-8")


def _measured() -> float:
    """CPU seconds of the load: the least of several turns, which other processes disturb least."""
    import numpy as np

    generator = np.random.default_rng(0)
    values, field = generator.random(1 << 15), generator.random((128, 128))

    def turn() -> float:
        begin = time.thread_time()
        values[np.argsort(values, kind="stable")].cumsum()
        for _ in range(8):
            np.abs(np.fft.rfft2(field)).sum()
        return time.thread_time() - begin

    return min(turn() for _ in range(25)) or REFERENCE_SECONDS
