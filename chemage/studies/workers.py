"""Components and plugins that were registered by hand, not installed: how the workers of a sweep come to know them."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Iterable
from concurrent.futures import Executor, ThreadPoolExecutor
from importlib.util import find_spec
from typing import Any

from chemage.foundation.errors import ExecutorError, InputError
from chemage.plugins import registry
from chemage.plugins.loading import PluginRecord
from chemage.plugins.sources import components_in, stage_hooks

#: (name, "module:Class") of a component, (name, "module") of a plugin with hooks
Known = tuple[tuple[str, str], ...]


def registered_classes(components: Iterable[Any]) -> set[type]:
    """The classes of ``components`` and of their parts that are registered by hand."""
    plugins = registry.current()
    classes = {type(part) for part in components_in(list(components))}
    return {cls for cls in classes if (record := plugins.provider(cls)) is not None and record.component is cls}


def for_workers(executor: str | Executor, classes: Iterable[type]) -> Known:
    """What workers must import: of ``classes``, and of the plugins with hooks that are registered by hand.

    Raises
    ------
    InputError
        The executor uses other processes, and they cannot import one of them.
    """
    if _same_process(executor):
        return ()
    modules = []
    for cls in sorted(classes, key=lambda one: one.__qualname__):
        if "." in cls.__qualname__ or not _importable(cls.__module__, cls.__qualname__, cls):
            role, kind = getattr(cls, "role", ""), getattr(cls, "kind", "")
            raise InputError(_refusal(f"the class {cls.__qualname__} ({role} {kind!r})", cls.__module__))
        modules.append((cls.__qualname__, f"{cls.__module__}:{cls.__qualname__}"))
    plugins = registry.current()
    answering = plugins.implementing(*stage_hooks())
    for record in plugins.records:
        if record.distribution or record.name not in answering:
            continue
        if not _importable(record.module, "", plugins.implementation(record.name)):
            raise InputError(_refusal(f"the plugin {record.name!r}", record.module))
        modules.append((record.name, record.module))
    return tuple(modules)


def _refusal(what: str, module: str) -> str:
    return (
        f"{what} was registered by hand from {module}, which worker processes cannot import; nothing was computed. Put "
        "it into a module, a .py file on the import path, and register it from there; or compute in this process "
        '(executor="serial")'
    )


def _same_process(executor: str | Executor) -> bool:
    if isinstance(executor, str):
        return executor == "serial"
    context = getattr(executor, "_mp_context", None)  # forked workers are copies of this process
    return isinstance(executor, ThreadPoolExecutor) or (context is not None and context.get_start_method() == "fork")


def _importable(module: str, name: str, expected: Any) -> bool:
    if module == "__main__" or module not in sys.modules:
        return False
    try:
        spec = find_spec(module)
    except (ImportError, ValueError):
        return False
    loaded = sys.modules[module]
    return spec is not None and (getattr(loaded, name, None) if name else loaded) is expected


def learn(known: Known) -> None:
    """Register what :func:`for_workers` gave, as far as this process does not know it.

    Raises
    ------
    ExecutorError
        It cannot be imported here.
    """
    plugins = registry.current()
    for name, target in known:
        module, _, attribute = target.partition(":")
        try:
            loaded: Any = importlib.import_module(module)
            component = getattr(loaded, attribute) if attribute else loaded
        except (ImportError, AttributeError) as error:
            raise ExecutorError(
                f"a worker cannot import {target} ({error}); the module must be on the import path of every worker"
            ) from None
        if not any(_is(record, name, component) for record in plugins.records):
            if attribute:
                plugins.register_class(component)
            else:
                plugins.register(component, name)


def _is(record: PluginRecord, name: str, loaded: Any) -> bool:
    return record.component is loaded if record.component is not None else record.name == name
