"""The machine: where what is made once for it is kept (compiled kernels, its speed, tables), its processor, its speed.

The processor that kernels are compiled for, whether numpy uses AVX-512, and the kernel of BLAS change last bits.
"""

from __future__ import annotations

import os
import platform
import time
from contextlib import suppress
from functools import lru_cache
from pathlib import Path

import platformdirs

#: CPU seconds that the load of :func:`slowness` takes on a machine where the estimates of components hold
REFERENCE_SECONDS = 4.3e-3
#: of the load, and of its file
_VERSION = 2
#: instructions that change how products are rounded, or how many numbers are added at once
_FEATURES = ("fma", "avx2", "avx512f", "neon", "sve")
#: numpy's names of AVX-512, from 2.4 on and before, in ``NPY_DISABLE_CPU_FEATURES``
_OF_NUMPY = {"X86_V4", "AVX512_SKX"}


def cache_folder() -> Path:
    """The folder for what can be computed again: ``CHEMAGE_CACHE``, or ``chemage`` where this system has such folders
    (``$XDG_CACHE_HOME`` or ``~/.cache``, ``~/Library/Caches``, ``%LOCALAPPDATA%``). It may not be there yet."""
    chosen = os.environ.get("CHEMAGE_CACHE") or platformdirs.user_cache_dir(
        "chemage", appauthor=False
    )
    return Path(chosen)


# -- compiled kernels -------------------------------------------------------------------------------------------------


def kernel_folder() -> Path:
    """The folder below which chemage keeps kernels: ``NUMBA_CACHE_DIR``, or one in :func:`cache_folder`; or a temporary
    one of this user where that cannot be written."""
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    return _usable(Path(chosen) if chosen else cache_folder() / "kernels")


def is_cold() -> bool:
    """Whether no kernel of chemage is kept yet, of whatever version; numba is not needed for that."""
    return not any(kernel_folder().glob("chemage.foundation-*/*.nbi"))


@lru_cache
def _usable(folder: Path) -> Path:
    return folder if _is_writable(folder) else _temporary()


def _is_writable(folder: Path) -> bool:
    while not folder.exists() and folder != folder.parent:
        folder = folder.parent
    return folder.is_dir() and os.access(folder, os.W_OK | os.X_OK)


def _temporary() -> Path:
    import tempfile

    user = str(os.getuid()) if hasattr(os, "getuid") else "user"
    folder = Path(tempfile.gettempdir()) / f"chemage-kernels-{user}"
    with suppress(OSError):
        folder.mkdir(mode=0o700, exist_ok=True)
        status = folder.lstat()
        # compiled code is executed, so that nobody else may be able to put any there
        ours = os.name != "posix" or (
            status.st_uid == os.getuid() and not status.st_mode & 0o022
        )
        if ours and not folder.is_symlink():
            return folder
    return Path(tempfile.mkdtemp(prefix="chemage-kernels-"))


# -- processor and speed ----------------------------------------------------------------------------------------------


@lru_cache(maxsize=1)
def processor() -> str:
    """Name of the processor, those of its instructions on which the last bits depend, and the kernel of numpy's BLAS,
    in one line."""
    blas = blas_kernel()
    return f"{_instructions()}, BLAS {blas}" if blas else _instructions()


def blas_kernel() -> str:
    """The kernel that the OpenBLAS of numpy chose for this processor or was given (``OPENBLAS_CORETYPE``), such as
    ``Haswell``; "" for another library."""
    import ctypes

    import numpy as np

    package = Path(np.__file__).parent
    for folder in (
        package.parent / "numpy.libs",
        package / ".dylibs",
    ):  # of wheels; numpy has loaded it
        for path in folder.glob("*openblas*"):
            library = ctypes.CDLL(str(path))
            for name in (
                "scipy_openblas_get_corename64_",
                "openblas_get_corename64_",
                "openblas_get_corename",
            ):
                if (ask := getattr(library, name, None)) is not None:
                    ask.restype = ctypes.c_char_p
                    return ask().decode()
    return ""


def _instructions() -> str:
    named = os.environ.get("NUMBA_CPU_NAME")
    try:
        from llvmlite import binding

        there, host = binding.get_host_cpu_features(), binding.get_host_cpu_name()
    except (ImportError, RuntimeError, OSError):
        return f"{named} (NUMBA_CPU_NAME)" if named else platform.machine()
    wide = bool(there.get("avx512f"))
    in_numpy = wide and not _OF_NUMPY & set(
        os.environ.get("NPY_DISABLE_CPU_FEATURES", "").replace(",", " ").split()
    )
    if named:
        return f"{named} (NUMBA_CPU_NAME{', numpy with AVX-512' * in_numpy})"
    features = [feature for feature in _FEATURES if there.get(feature)]
    less = ", numpy without AVX-512" * (wide and not in_numpy)
    return (
        f"{host} ({', '.join(features) or 'none of ' + ', '.join(_FEATURES)}{less})"
    )


@lru_cache(maxsize=1)
def slowness() -> float:
    """CPU time of a computation on this machine over that on the one for which components state their seconds.

    A load of a few milliseconds (Fourier transforms, sorting, gathering) is timed when this is first asked for, and the
    result is kept in :func:`cache_folder`. A file that is damaged, or of another processor, is measured again.
    """
    from chemage.foundation.container import read_json, sealed_json
    from chemage.foundation.files import write_file

    file = cache_folder() / "speed.json"
    identity = {
        "version": _VERSION,
        "processor": processor(),
        "node": platform.node(),
    }
    with suppress(OSError, ValueError, TypeError, KeyError):
        kept = read_json(file)
        if {name: kept[name] for name in identity} == identity and 0 < (
            seconds := float(kept["seconds"])
        ) < 1:
            return seconds / REFERENCE_SECONDS
    seconds = _seconds_of_load()
    with suppress(
        Exception
    ):  # a folder that cannot be written is no reason to fail
        file.parent.mkdir(parents=True, exist_ok=True)
        write_file(file, sealed_json({**identity, "seconds": seconds}), force=True)
    return seconds / REFERENCE_SECONDS


def _seconds_of_load() -> float:
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
