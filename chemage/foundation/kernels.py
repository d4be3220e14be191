"""Kernels: functions that numba compiles, and whose machine code chemage keeps."""

from __future__ import annotations

import inspect
import io
import os
import shutil
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import Any

import llvmlite
import numba
from llvmlite import binding
from numba.core import caching, config

from chemage.foundation.container import is_intact, seal
from chemage.foundation.errors import InputError
from chemage.foundation.machine import kernel_folder
from chemage.foundation.records import text_hash

if getattr(config, "DISABLE_JIT", 0):
    raise InputError.of(
        "NUMBA_DISABLE_JIT",
        os.environ.get("NUMBA_DISABLE_JIT", "1"),
        "chemage works with compiled kernels alone",
        "run: unset NUMBA_DISABLE_JIT",
    )

#: of each package, so many folders of kernels are left, and those used within so many seconds
KEPT, RECENT = 16, 86400.0


def kernel(function: Callable[..., Any] | None = None, **options: Any) -> Any:
    """``numba.njit`` with these options, whose machine code is kept in the cache folder of chemage.

    It may call functions of the same package, of :mod:`chemage.plugin.random` and of :mod:`chemage.plugin.algebra`, and
    is compiled again when any file of its package, chemage, numba or the processor is another. numba's own cache would
    compare the file of this function alone, and go on using what an old version of another file made.
    """

    def compiled(function: Callable[..., Any]) -> Any:
        dispatcher: Any = numba.njit(**options)(function)
        sources = _sources_of(function)
        if sources is not None:
            dispatcher._cache = _Cache(function, sources)
        return dispatcher

    return compiled if function is None else compiled(function)


def _sources_of(function: Callable[..., Any]) -> Sources | None:
    """The sources of a kernel; None where it is in no file, as in a notebook."""
    parts = function.__module__.split(".")
    # the rooms of chemage share the kernels of random.py and algebra.py alone
    package = ".".join(parts[: 2 if parts[0] == "chemage" else 1])
    roots = getattr(sys.modules.get(package), "__path__", None) or [
        inspect.getfile(function)
    ]
    return _sources(package, *roots) if all(map(os.path.exists, roots)) else None


class Sources:
    """The files of a package whose functions its kernels may contain, as they were when its first kernel was imported,
    and the folder of these kernels, whose name is a digest of the files and of what compiles them."""

    def __init__(self, package: str, *roots: str) -> None:
        self.package = package
        self._roots = roots
        self._stamps = self._found()
        content = [repr(_compiler())]
        for path, (size, _) in self._stamps.items():
            with open(path, encoding="utf-8", errors="backslashreplace") as file:
                content.append(f"\n{os.path.basename(path)} {size}\n{file.read()}")
        self.folder = kernel_folder() / f"{package}-{text_hash(''.join(content))}"
        with suppress(OSError):
            os.utime(self.folder)  # it is in use

    def _found(self) -> dict[str, tuple[int, int]]:
        """Path -> size and modification time of each file, chemage's own for all kernels included."""
        paths = [
            str(Path(__file__).with_name(name))
            for name in ("kernels.py", "random.py", "algebra.py")
        ]
        for root in self._roots:
            if os.path.isfile(root):
                paths.append(root)
            for folder, _, names in sorted(os.walk(root)):
                paths += [
                    os.path.join(folder, name)
                    for name in sorted(names)
                    if name.endswith(".py")
                ]
        return {
            path: ((status := os.stat(path)).st_size, status.st_mtime_ns)
            for path in paths
        }

    def unchanged(self) -> bool:
        """Whether the files are still those that were imported; what is compiled beside others is not kept."""
        with suppress(OSError):
            return self._found() == self._stamps
        return False

    def make_folder(self) -> None:
        """Make the folder; of those of other versions the ones that were used last are left."""
        if self.folder.is_dir():
            return
        self.folder.mkdir(parents=True, exist_ok=True)
        last_use = {}
        for folder in self.folder.parent.glob(f"{self.package}-{'[0-9a-f]' * 32}"):
            with suppress(OSError):  # another process has removed it
                last_use[folder] = folder.stat().st_mtime
        for folder in sorted(last_use, key=last_use.__getitem__, reverse=True)[
            KEPT:
        ]:
            if last_use[folder] < time.time() - RECENT:
                shutil.rmtree(folder, ignore_errors=True)


def _compiler() -> tuple[str, ...]:
    """What compiles kernels, and for which processor."""
    name, features = (vars(config)[field] for field in ("CPU_NAME", "CPU_FEATURES"))
    name = name or binding.get_host_cpu_name()
    if features is None:
        features = binding.get_host_cpu_features().flatten()
    return numba.__version__, llvmlite.__version__, name, features


_sources = cache(Sources)


class _Locator(caching._CacheLocator):
    """Where the kernels of a package are kept."""

    def __init__(self, function: Any, sources: Sources) -> None:
        self._py_file = inspect.getfile(function)  # which warnings of numba name
        self._line = function.__code__.co_firstlineno
        self.sources = sources

    def ensure_cache_path(self) -> None:
        self.sources.make_folder()

    def get_cache_path(self) -> Any:
        return str(self.sources.folder)

    def get_source_stamp(self) -> Any:
        return self.sources.folder.name

    def get_disambiguator(self) -> Any:
        return str(self._line)


class _Files(caching.IndexDataCacheFile):
    """Files that end with a seal: a damaged kernel might compute something else, and is compiled again."""

    def _load_index(self) -> Any:
        with suppress(OSError):
            if is_intact(Path(self._index_path)):
                return super()._load_index()
        return {}

    def _load_data(self, name: str) -> Any:
        if not is_intact(Path(self._data_path(name))):
            raise OSError(f"{name} has no seal")  # numba compiles again
        return super()._load_data(name)

    @contextmanager
    def _open_for_write(self, filepath: str) -> Iterator[Any]:
        image = io.BytesIO()
        yield image
        with super()._open_for_write(filepath) as stream:
            stream.write(seal(image))


class _Content(caching.CompileResultCacheImpl):
    """What is kept of a kernel."""

    def __init__(self, function: Any, sources: Sources) -> None:
        self._lineno = function.__code__.co_firstlineno
        self._locator = _Locator(function, sources)
        name = f"{function.__module__}.{function.__qualname__}"
        self._filename_base = self.get_filename_base(
            name, getattr(sys, "abiflags", "")
        )


class _Cache(caching.FunctionCache):
    """The cache of one kernel."""

    def __init__(self, function: Any, sources: Sources) -> None:
        self._name = repr(function)
        self._py_func = function
        self._impl: Any = _Content(function, sources)
        locator = self._impl.locator
        self._cache_path = locator.get_cache_path()
        self._cache_file = _Files(
            self._cache_path, self._impl.filename_base, locator.get_source_stamp()
        )
        self.enable()

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        return (
            super().load_overload(sig, target_context)
            if self._impl.locator.sources.unchanged()
            else None
        )

    def save_overload(self, sig: Any, data: Any) -> None:
        if self._impl.locator.sources.unchanged():
            with suppress(
                OSError
            ):  # a folder that cannot be written is no reason to fail
                super().save_overload(sig, data)
