"""Finds plugins, loads a choice on first use, and explains what is wrong when it cannot.

Nothing heavy happens here: an entry point's module is imported (light by contract), its ``chemage_register`` strings
are kept, and the class behind a kind is imported when somebody asks for it. A broken plugin is recorded and skipped;
with ``CHEMAGE_STRICT=1`` it raises. ``CHEMAGE_TRACE=1`` prints every hook call to stderr.
"""

from __future__ import annotations

import importlib
import os
import sys
import threading
import warnings
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from importlib import metadata
from typing import Any

import pluggy

from chemage import hookspecs
from chemage.errors import InputError, PluginError, UnknownKindError

GROUP = "chemage"


class PluginWarning(UserWarning):
    """A plugin was skipped because it is broken."""


@dataclass
class PluginRecord:
    """What is known of one plugin."""

    name: str
    distribution: str
    version: str
    module: str
    kinds: dict[str, dict[str, str]] = field(default_factory=dict)
    scenes: dict[str, str] = field(default_factory=dict)
    #: why it was skipped, in words; empty when it works
    error: str = ""

    @property
    def source(self) -> str:
        """``distribution version``, or the module where there is no distribution."""
        return f"{self.distribution} {self.version}".strip() if self.distribution else self.module


class Registry:
    """One set of plugins. ``chemage.registry.current()`` is the one in use."""

    def __init__(
        self, entry_points: Iterable[metadata.EntryPoint] | None = None, *, strict: bool | None = None
    ) -> None:
        self.strict = os.environ.get("CHEMAGE_STRICT", "") not in ("", "0") if strict is None else strict
        self.manager = pluggy.PluginManager("chemage")
        self.manager.add_hookspecs(hookspecs)
        self.records: list[PluginRecord] = []
        self._classes: dict[tuple[str, str], type] = {}
        if os.environ.get("CHEMAGE_TRACE", "") not in ("", "0"):
            self.manager.add_hookcall_monitoring(_trace_before, _trace_after)
        from chemage import answers

        self.manager.register(answers, "chemage")
        found = metadata.entry_points(group=GROUP) if entry_points is None else entry_points
        # chemage's own first, the rest by name: the order never depends on the file system
        for point in sorted(found, key=lambda p: (not (p.dist is not None and p.dist.name == "chemage"), p.name)):
            self._load(point)
        for record in self.records:
            if record.error:
                warnings.warn(
                    f"plugin {record.name!r} ({record.source}) was skipped: {record.error}", PluginWarning, stacklevel=2
                )

    def _load(self, point: metadata.EntryPoint) -> None:
        dist = point.dist
        record = PluginRecord(point.name, dist.name if dist else "", dist.version if dist else "", point.value)
        self.records.append(record)
        try:
            self._register(point.load(), record)
        except (Exception, SystemExit) as error:  # a plugin that exits when imported must not end the program
            if self.strict:
                raise PluginError(
                    f"plugin {record.name!r} ({record.source}): {type(error).__name__}: {error}"
                ) from error
            record.error = f"{type(error).__name__}: {error}"

    def register(self, plugin: Any, name: str) -> PluginRecord:
        """Add a plugin by hand (a module or any object with hook implementations); a broken one raises."""
        record = PluginRecord(name, "", "", getattr(plugin, "__name__", type(plugin).__name__))
        try:
            self._register(plugin, record)
        except Exception as error:
            raise PluginError(f"plugin {name!r}: {type(error).__name__}: {error}") from error
        self.records.append(record)
        return record

    def _register(self, plugin: Any, record: PluginRecord) -> None:
        api = getattr(plugin, "CHEMAGE_API", hookspecs.API_VERSION)
        if api != hookspecs.API_VERSION:
            raise PluginError(f"made for plugin interface {api}, this chemage has {hookspecs.API_VERSION}")
        name = f"{record.name} ({record.source})"
        if self.manager.has_plugin(name) or self.manager.is_registered(plugin):
            raise PluginError(f"{record.module} is registered twice")
        _check_hook_names(plugin)
        try:
            self.manager.register(plugin, name)
            for hook in self.manager.get_hookcallers(plugin) or ():
                for impl in hook.get_hookimpls():
                    if impl.plugin is plugin and hook.name == "chemage_register":
                        record.kinds = _checked_kinds(impl.function())
                    elif impl.plugin is plugin and hook.name == "chemage_scenes":
                        record.scenes = _checked_targets("chemage_scenes", impl.function())
        except (Exception, SystemExit):
            # older pluggy keeps the hooks that come before the one at fault
            if self.manager.is_registered(plugin):
                self.manager.unregister(plugin)
            record.kinds, record.scenes = {}, {}
            raise

    def answering(self) -> list[str]:
        """Names of the plugins, other than chemage itself, that answer or wrap an arrow, sorted: what they do
        is part of a result, but not of its scene."""
        found = {
            implementation.plugin_name.split(" (")[0]
            for name in hookspecs.ARROWS
            for implementation in getattr(self.manager.hook, name).get_hookimpls()
        }
        return sorted(found - {"chemage"})

    # -- choices ------------------------------------------------------------------------------------------------------

    def kinds(self, role: str) -> list[str]:
        """Kinds installed for ``role``, sorted."""
        return sorted({kind for record in self.records for kind in record.kinds.get(role, ())})

    def offers(self, role: str, kind: str) -> list[PluginRecord]:
        """The plugins that claim ``kind``."""
        return [record for record in self.records if kind in record.kinds.get(role, ())]

    def clashes(self) -> list[str]:
        """A sentence for each kind claimed more than once."""
        return [
            _clash(role, kind, offers)
            for role in _roles()
            for kind in self.kinds(role)
            if len(offers := self.offers(role, kind)) > 1
        ]

    def choice(self, role: str, kind: str) -> type:
        """The class behind ``kind``.

        Raises
        ------
        UnknownKindError
            Nothing installed offers it; the message lists what is and suggests the nearest.
        PluginError
            Two plugins claim it, or the class cannot be imported or is not of that role.
        """
        if (role, kind) in self._classes:
            return self._classes[role, kind]
        if role not in _roles():
            raise InputError(f"no such role {role!r}; the roles are {', '.join(_roles())}")
        offers = self.offers(role, kind)
        if not offers:
            from chemage.spec import nearest

            installed = self.kinds(role)
            broken = [record.name for record in self.records if record.error]
            raise UnknownKindError(
                f"no {role} {kind!r}{nearest(kind, installed)}; installed: {', '.join(installed) or 'none'}"
                + (f" (skipped because broken: {', '.join(broken)})" if broken else "")
            )
        if len(offers) > 1:
            raise PluginError(_clash(role, kind, offers))
        self._classes[role, kind] = cls = _import(role, kind, offers[0])
        return cls

    def make(self, role: str, kind: str, options: Mapping[str, Any]) -> Any:
        """The choice ``kind`` with ``options``."""
        return self.choice(role, kind)(**options)

    def scenes(self) -> dict[str, str]:
        """Installed scenes: name -> ``"package:file"``."""
        return {name: target for record in self.records for name, target in record.scenes.items()}

    def scene_target(self, name: str) -> str:
        """Where the scene ``name`` is; two plugins that ship one name are an error."""
        holders = [record for record in self.records if name in record.scenes]
        if len(holders) > 1:
            raise PluginError(_clash("scene", name, holders))
        return holders[0].scenes[name]

    def check(self) -> list[str]:
        """Everything that is wrong, a sentence each: broken plugins, clashes, targets that cannot be imported."""
        problems = [f"plugin {r.name!r} ({r.source}): {r.error}" for r in self.records if r.error]
        problems += self.clashes()
        for record in self.records:
            for role, kinds in record.kinds.items():
                for kind in kinds:
                    try:
                        _import(role, kind, record)
                    except PluginError as error:
                        problems.append(str(error))
            for name, target in record.scenes.items():
                try:
                    scene_text(target)
                except Exception as error:
                    problems.append(f"scene {name!r} of plugin {record.name!r}: {target}: {error}")
        return problems


def _roles() -> list[str]:
    from chemage.spec import ROLES

    return list(ROLES)


def _check_hook_names(plugin: Any) -> None:
    """Refuse what pluggy would silently ignore: a misspelled hook, a hook without ``@chemage.hookimpl``, no hook."""
    from chemage.spec import nearest

    known = [name for name in dir(hookspecs) if name.startswith("chemage_")]
    found = 0
    for name in dir(plugin):
        function = getattr(plugin, name)
        marked = getattr(function, "chemage_impl", None)
        if not callable(function) or (marked is None and not name.startswith("chemage_")):
            continue
        hook = (marked or {}).get("specname") or name
        if hook not in known:
            raise PluginError(
                f"implements {hook}, which is not a hook{nearest(hook, known)}; the hooks are {', '.join(known)}"
            )
        if marked is None:
            raise PluginError(f"{name} is not marked as a hook; write @chemage.hookimpl above it")
        found += 1
    if not found:
        raise PluginError(f"implements no hook; the hooks are {', '.join(known)}")


def _clash(role: str, kind: str, offers: list[PluginRecord]) -> str:
    return (
        f"{role} {kind!r} is claimed by {' and by '.join(f'{r.name!r} ({r.source})' for r in offers)}; "
        "uninstall one of them"
    )


def _checked_kinds(offer: Any) -> dict[str, dict[str, str]]:
    kinds: dict[str, dict[str, str]] = {}
    if not isinstance(offer, Mapping):
        raise PluginError(f"chemage_register gave {offer!r}; expected {{role: {{kind: 'module:Class'}}}}")
    for role, targets in offer.items():
        if role not in _roles():
            raise PluginError(f"chemage_register names the role {role!r}; the roles are {', '.join(_roles())}")
        kinds[role] = _checked_targets(f"chemage_register: {role}", targets)
    return kinds


def _checked_targets(where: str, targets: Any) -> dict[str, str]:
    if not isinstance(targets, Mapping):
        raise PluginError(f"{where}: expected {{name: 'module:thing'}}, got {targets!r}")
    for name, target in targets.items():
        if not isinstance(name, str) or not isinstance(target, str) or target.count(":") != 1:
            raise PluginError(f"{where} {name!r}: expected 'module:thing', got {target!r}")
    return dict(targets)


def _import(role: str, kind: str, record: PluginRecord) -> type:
    from chemage.spec import ROLES

    target = record.kinds[role][kind]
    module, _, name = target.partition(":")
    where = f"{role} {kind!r} of plugin {record.name!r} ({record.source})"
    try:
        cls = getattr(importlib.import_module(module), name)
    except Exception as error:
        raise PluginError(f"{where}: {target} cannot be imported: {type(error).__name__}: {error}") from error
    if not (isinstance(cls, type) and issubclass(cls, ROLES[role])):
        raise PluginError(f"{where}: {target} is not a chemage.spec.{ROLES[role].__name__}")
    if cls.kind != kind:
        raise PluginError(f"{where}: the class calls itself {cls.kind!r}; set kind = {kind!r}")
    if abstract := getattr(cls, "__abstractmethods__", None):
        raise PluginError(f"{where}: {target} does not define {', '.join(sorted(abstract))}")
    return cls


def scene_text(target: str) -> str:
    """The text of a shipped scene, ``"package:file.toml"``."""
    from importlib import resources

    package, _, name = target.partition(":")
    return resources.files(package).joinpath(name).read_text(encoding="utf-8")


def _trace_before(hook_name: str, methods: Any, kwargs: Mapping[str, Any]) -> None:
    print(f"chemage hook {hook_name}({', '.join(kwargs)}) -> {[m.plugin_name for m in methods]}", file=sys.stderr)


def _trace_after(outcome: Any, hook_name: str, methods: Any, kwargs: Mapping[str, Any]) -> None:
    print(f"chemage hook {hook_name} done", file=sys.stderr)


_current: Registry | None = None
_discovery = threading.Lock()


def current() -> Registry:
    """The registry in use; plugins are discovered on the first call."""
    global _current
    if _current is None:
        with _discovery:
            if _current is None:
                _current = Registry()
    return _current


@contextmanager
def using(registry: Registry) -> Iterator[Registry]:
    """Use another registry within a block (for tests of plugins)."""
    global _current
    before, _current = _current, registry
    try:
        yield registry
    finally:
        _current = before


def surface(kind: str, **options: Any) -> Any:
    """A surface maker: ``chemage.surface("self-affine", pixels=2500, ...).make(seed=1)``."""
    return current().make("surface", kind, options)


def contact(kind: str, **options: Any) -> Any:
    """A contact solver: ``chemage.contact("fft-bem", modulus="35.3 GPa").solve(surface, load="20 uN")``."""
    return current().make("contact", kind, options)


def barriers(kind: str, **options: Any) -> Any:
    """A distribution of energy barriers."""
    return current().make("barriers", kind, options)


def interaction(kind: str, **options: Any) -> Any:
    """A rule for which sites feel each other."""
    return current().make("interaction", kind, options)


def engine(kind: str, **options: Any) -> Any:
    """A kinetic Monte Carlo engine: ``chemage.engine("bkl").run(lattice, times, temperature=300, seed=3)``."""
    return current().make("engine", kind, options)


def observable(kind: str, **options: Any) -> Any:
    """A further measurement on each replica."""
    return current().make("observable", kind, options)


def fromdict(role: str, fields: Mapping[str, Any]) -> Any:
    """A choice from its ``todict()``."""
    options = dict(fields)
    if "kind" not in options:
        raise InputError(f"{role}: kind is required; installed: {', '.join(current().kinds(role)) or 'none'}")
    return current().make(role, options.pop("kind"), options)
