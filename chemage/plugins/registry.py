"""The registry: finds plugins, loads a component on first use, and explains what is wrong when it cannot.

Nothing heavy happens here: an entry point's module is imported (light by contract), its ``chemage_register`` strings
are kept, and the class behind a kind is imported when it is first used. A broken plugin is recorded and skipped;
with ``CHEMAGE_STRICT=1`` it raises. ``CHEMAGE_PLUGINS=-name`` leaves a plugin out, ``CHEMAGE_PLUGINS=name,other`` uses
just these besides chemage's own. ``CHEMAGE_TRACE=1`` prints every hook call to stderr.

The rooms of chemage declare their roles and hooks in modules that are found by name, as the modules of plugins are:
the registry knows no stage.
"""

from __future__ import annotations

import hashlib
import importlib
import inspect
import os
import sys
import threading
import warnings
import weakref
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from importlib import metadata
from typing import Any, TypeVar

import pluggy

from chemage.foundation.errors import InputError, PluginError, UnknownKindError
from chemage.plugins import hooks
from chemage.plugins.participation import Plugins, record_participation, taking_part

GROUP = "chemage"
#: modules in which the rooms of chemage declare roles (``ROLES``), hooks, and their own answers (``Default``)
ROOMS = (
    "chemage.plugins.hooks",
    "chemage.surfaces.hooks",
    "chemage.contacts.hooks",
    "chemage.lattices.hooks",
    "chemage.kinetics.hooks",
    "chemage.ageing.hooks",
    "chemage.experiments.hooks",
    "chemage.reports.hooks",
    "chemage.cli.hooks",
)
T = TypeVar("T")


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
    #: the class, where it was registered by hand
    component: Any = None
    #: libraries that it names as its basis (``CHEMAGE_LIBRARIES``) -> version
    libraries: dict[str, str] = field(default_factory=dict)

    @property
    def source(self) -> str:
        """``distribution version (library version, ...)``, or the module where there is no distribution."""
        libraries = ", ".join(f"{name} {version}" for name, version in self.libraries.items())
        return f"{self.distribution or self.module} {self.version} {f'({libraries})' if libraries else ''}".strip()


class Registry:
    """One set of plugins; :func:`current` gives the one in use."""

    def __init__(
        self, entry_points: Iterable[metadata.EntryPoint] | None = None, *, strict: bool | None = None
    ) -> None:
        self.strict = os.environ.get("CHEMAGE_STRICT", "") not in ("", "0") if strict is None else strict
        self.manager = pluggy.PluginManager("chemage")
        self.records: list[PluginRecord] = []
        #: role -> "module:Class" of its abstract class
        self.roles: dict[str, str] = {}
        self._classes: dict[tuple[str, str], type] = {}
        if os.environ.get("CHEMAGE_TRACE", "") not in ("", "0"):
            self.manager.add_hookcall_monitoring(_trace_before, _trace_after)
        for name in ROOMS:
            self._add_room(importlib.import_module(name))
        found = _selected(metadata.entry_points(group=GROUP)) if entry_points is None else entry_points
        # chemage's own first, the rest by name: the order never depends on the file system
        for point in sorted(found, key=lambda p: (not (p.dist is not None and p.dist.name == "chemage"), p.name)):
            self._load(point)
        for record in self.records:
            if record.error:
                warnings.warn(
                    f"plugin {record.name!r} ({record.source}) was skipped: {record.error}", PluginWarning, stacklevel=2
                )

    def _add_room(self, room: Any) -> None:
        self.manager.add_hookspecs(room)
        self.roles |= getattr(room, "ROLES", {})
        default = getattr(room, "Default", None)
        if default is not None:
            self.manager.register(default(), room.__name__.removesuffix(".hooks"))

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

    def register_class(self, cls: Any) -> PluginRecord:
        """Make a component class usable by its kind without packaging; the same name defined again replaces it.

        Raises
        ------
        PluginError
            The class is not complete, or a plugin offers its kind already.
        """
        role, kind = getattr(cls, "role", ""), getattr(cls, "kind", "")
        if role not in self.roles or not kind:
            raise PluginError(f"{cls!r} is no component with a role and a kind; subclass a role such as chemage.Engine")
        name = f"{cls.__module__}.{cls.__qualname__}"
        self.records = [record for record in self.records if record.name != name]
        self._classes.pop((role, kind), None)
        record = PluginRecord(name, "", source_version(cls), cls.__module__, {role: {kind: name}}, component=cls)
        if others := self.offers(role, kind):
            raise PluginError(_clash(role, kind, [*others, record]))
        self._classes[role, kind] = self._checked(cls, role, kind, record)
        self.records.append(record)
        return record

    def unregister_class(self, cls: Any) -> None:
        """The inverse of :meth:`register_class`."""
        self.records = [record for record in self.records if record.component is not cls]
        self._classes.pop((cls.role, cls.kind), None)

    def _register(self, plugin: Any, record: PluginRecord) -> None:
        api = getattr(plugin, "CHEMAGE_API", hooks.API_VERSION)
        if api != hooks.API_VERSION:
            raise PluginError(f"made for plugin interface {api}, this chemage has {hooks.API_VERSION}")
        record.libraries = _versions(getattr(plugin, "CHEMAGE_LIBRARIES", ()))
        name = _full_name(record)
        if self.manager.has_plugin(name) or self.manager.is_registered(plugin):
            raise PluginError(f"{record.module} is registered twice")
        _check_hook_names(plugin, self._hook_names())
        try:
            self.manager.register(plugin, name)
            for hook in self.manager.get_hookcallers(plugin) or ():
                for impl in hook.get_hookimpls():
                    if impl.plugin is not plugin:
                        continue
                    if hook.name == "chemage_register":
                        record.kinds = self._checked_kinds(impl.function())
                    elif hook.name == "chemage_scenes":
                        record.scenes = _checked_targets("chemage_scenes", impl.function())
                    else:
                        record_participation(impl, record.name, record.source, many=not _is_stage(hook))
        except (Exception, SystemExit):
            # older pluggy keeps the hooks that come before the one at fault
            if self.manager.is_registered(plugin):
                self.manager.unregister(plugin)
            record.kinds, record.scenes = {}, {}
            raise

    def _hook_names(self) -> list[str]:
        return [name for name in dir(self.manager.hook) if name.startswith("chemage_")]

    # -- stages -------------------------------------------------------------------------------------------------------

    def answer(self, hook: str, expected: type[T], **arguments: Any) -> tuple[T, Plugins]:
        """Call the hook of a stage: its answer, and the plugins that answered or changed it (name -> version).

        Raises
        ------
        PluginError
            A plugin answered with something else than ``expected``.
        """
        with taking_part() as plugins:
            result = getattr(self.manager.hook, hook)(**arguments)
        if not isinstance(result, expected):
            raise PluginError(
                f"a plugin answered {hook} with {type(result).__name__}; expected {expected.__name__} or None"
            )
        return result, dict(plugins)

    def implementing(self, *hook_names: str) -> Plugins:
        """The plugins, other than chemage's own rooms, that implement any of these hooks: name -> source, sorted."""
        names = {
            implementation.plugin_name
            for name in hook_names
            for implementation in getattr(self.manager.hook, name).get_hookimpls()
        }
        return {one.name: one.source for one in sorted(self.records, key=lambda r: r.name) if _full_name(one) in names}

    def functions(self, hook: str) -> list[tuple[PluginRecord, Any]]:
        """Each plugin that implements ``hook``, with its function, sorted by the name of the plugin."""
        found = {one.plugin_name: one.function for one in getattr(self.manager.hook, hook).get_hookimpls()}
        records = sorted(self.records, key=lambda record: record.name)
        return [(one, found[name]) for one in records if (name := _full_name(one)) in found]

    def implementation(self, name: str) -> Any:
        """The module or object with the hooks of the plugin ``name``."""
        return self.manager.get_plugin(next(_full_name(one) for one in self.records if one.name == name))

    def state(self) -> str:
        """A hash of all plugins with their versions."""
        text = "\n".join(sorted(f"{one.name} {one.source} {one.error}" for one in self.records))
        return hashlib.blake2b(text.encode(), digest_size=8).hexdigest()

    def source(self, name: str) -> str | None:
        """The source, with its version, of the plugin ``name``; None if it is not in use."""
        return next((one.source for one in self.records if one.name == name and not one.error), None)

    def provider(self, cls: type) -> PluginRecord | None:
        """The plugin whose component ``cls`` is; None for a class that is not registered."""
        role, kind = getattr(cls, "role", ""), getattr(cls, "kind", "")
        for record in self.offers(role, kind):
            if record.component is cls or record.kinds[role][kind] == f"{cls.__module__}:{cls.__qualname__}":
                return record
        # a package may give its class under another path
        return next(iter(self.offers(role, kind)), None) if self._classes.get((role, kind)) is cls else None

    def stage_hooks(self) -> list[str]:
        """The hooks of which one answer is used: those of the stages."""
        return [name for name in self._hook_names() if _is_stage(getattr(self.manager.hook, name))]

    # -- components ---------------------------------------------------------------------------------------------------

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
            for role in self.roles
            for kind in self.kinds(role)
            if len(offers := self.offers(role, kind)) > 1
        ]

    def component(self, role: str, kind: str) -> Any:
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
        self.role(role)
        offers = self.offers(role, kind)
        if not offers:
            from chemage.foundation.messages import nearest

            installed = self.kinds(role)
            broken = [record.name for record in self.records if record.error]
            raise UnknownKindError(
                f"no {role} {kind!r}{nearest(kind, installed)}; installed: {', '.join(installed) or 'none'}"
                + (f" (skipped because broken: {', '.join(broken)})" if broken else "")
            )
        if len(offers) > 1:
            raise PluginError(_clash(role, kind, offers))
        self._classes[role, kind] = cls = self._import(role, kind, offers[0])
        return cls

    def role(self, name: str) -> Any:
        """The abstract class of a role.

        Raises
        ------
        InputError
            There is no such role.
        """
        if name not in self.roles:
            raise InputError(f"no such role {name!r}; the roles are {', '.join(self.roles)}")
        return _imported(self.roles[name])

    def make(self, role: str, kind: str, options: Mapping[str, Any]) -> Any:
        """The component ``kind`` with ``options``."""
        return self.component(role, kind)(**options)

    def fromdict(self, role: str, fields: Mapping[str, Any]) -> Any:
        """A component from its ``todict()``."""
        options = dict(fields)
        if "kind" not in options:
            raise InputError(f"{role}: kind is required; installed: {', '.join(self.kinds(role)) or 'none'}")
        return self.make(role, options.pop("kind"), options)

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
                        self._import(role, kind, record)
                    except PluginError as error:
                        problems.append(str(error))
            for name, target in record.scenes.items():
                try:
                    scene_text(target)
                except Exception as error:
                    problems.append(f"scene {name!r} of plugin {record.name!r}: {target}: {error}")
        return problems

    def _checked_kinds(self, offer: Any) -> dict[str, dict[str, str]]:
        kinds: dict[str, dict[str, str]] = {}
        if not isinstance(offer, Mapping):
            raise PluginError(f"chemage_register gave {offer!r}; expected {{role: {{kind: 'module:Class'}}}}")
        for role, targets in offer.items():
            if role not in self.roles:
                raise PluginError(f"chemage_register names the role {role!r}; the roles are {', '.join(self.roles)}")
            kinds[role] = _checked_targets(f"chemage_register: {role}", targets)
        return kinds

    def _import(self, role: str, kind: str, record: PluginRecord) -> Any:
        if record.component is not None:
            return record.component
        target = record.kinds[role][kind]
        try:
            cls = _imported(target)
        except Exception as error:
            where = f"{role} {kind!r} of plugin {record.name!r} ({record.source})"
            raise PluginError(f"{where}: {target} cannot be imported: {type(error).__name__}: {error}") from error
        return self._checked(cls, role, kind, record)

    def _checked(self, cls: Any, role: str, kind: str, record: PluginRecord) -> Any:
        target = record.kinds[role][kind]
        where = f"{role} {kind!r} of plugin {record.name!r} ({record.source})"
        expected = self.role(role)
        if not (isinstance(cls, type) and issubclass(cls, expected)):
            raise PluginError(f"{where}: {target} is not a chemage.{expected.__name__}")
        if cls.kind != kind:
            raise PluginError(f"{where}: the class calls itself {cls.kind!r}; set kind = {kind!r}")
        if abstract := getattr(cls, "__abstractmethods__", None):
            raise PluginError(f"{where}: {target} does not define {', '.join(sorted(abstract))}")
        return cls


def _selected(found: Iterable[metadata.EntryPoint]) -> list[metadata.EntryPoint]:
    """The entry points that ``CHEMAGE_PLUGINS`` allows: names besides chemage's own, or ``-name`` to leave out."""
    points = list(found)
    words = [word.strip() for word in os.environ.get("CHEMAGE_PLUGINS", "").split(",") if word.strip()]
    without = {word[1:] for word in words if word.startswith("-")}
    only = {word for word in words if not word.startswith("-")}
    if unknown := (without | only) - {point.name for point in points}:
        installed = ", ".join(sorted(point.name for point in points))
        raise InputError(
            f"CHEMAGE_PLUGINS names {', '.join(sorted(unknown))}, which is not installed; the plugins are {installed}"
        )

    def wanted(point: metadata.EntryPoint) -> bool:
        own = point.dist is not None and point.dist.name == "chemage"
        return point.name not in without and (own or not only or point.name in only)

    return [point for point in points if wanted(point)]


_reading = threading.Lock()
_sources: weakref.WeakKeyDictionary[type, str] = weakref.WeakKeyDictionary()


def source_version(cls: type) -> str:
    """What stands for the version of a class that is not packaged: a hash of its source, which is read once."""
    with _reading:  # Python 3.11 cannot parse in two threads at once
        if cls not in _sources:
            try:
                text = inspect.getsource(cls)
            except (OSError, TypeError):
                _sources[cls] = "(source unknown)"
            else:
                _sources[cls] = f"(source {hashlib.blake2b(text.encode(), digest_size=4).hexdigest()})"
        return _sources[cls]


def _full_name(record: PluginRecord) -> str:
    return f"{record.name} ({record.source})"


def _versions(libraries: Any) -> dict[str, str]:
    """The versions of the distributions that a plugin names as its basis."""
    if isinstance(libraries, str) or not all(isinstance(name, str) for name in libraries):
        raise PluginError(f"CHEMAGE_LIBRARIES = {libraries!r}: give a tuple of names of distributions")
    return {name: metadata.version(name) for name in libraries}


def _is_stage(hook: Any) -> bool:
    return hook.spec is not None and bool(hook.spec.opts["firstresult"])


def _check_hook_names(plugin: Any, known: list[str]) -> None:
    """Refuse what pluggy would silently ignore: a misspelled hook, a hook without ``@chemage.hookimpl``, no hook."""
    from chemage.foundation.messages import nearest

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


def _checked_targets(where: str, targets: Any) -> dict[str, str]:
    if not isinstance(targets, Mapping):
        raise PluginError(f"{where}: expected {{name: 'module:thing'}}, got {targets!r}")
    for name, target in targets.items():
        if not isinstance(name, str) or not isinstance(target, str) or target.count(":") != 1:
            raise PluginError(f"{where} {name!r}: expected 'module:thing', got {target!r}")
    return dict(targets)


def _imported(target: str) -> Any:
    module, _, name = target.partition(":")
    return getattr(importlib.import_module(module), name)


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


def fromdict(role: str, fields: Mapping[str, Any]) -> Any:
    """A component from its ``todict()``."""
    return current().fromdict(role, fields)


def register(cls: T) -> T:
    """Make a component class usable by its kind at once, without packaging: in a notebook, as a decorator or a call.

    Defining the class again and registering it replaces it. Files written with it name it with a hash of its source.

    Raises
    ------
    PluginError
        The class is not complete, or a plugin offers its kind already.
    """
    current().register_class(cls)
    return cls


def unregister(cls: Any) -> None:
    """Forget a class that :func:`register` made usable."""
    current().unregister_class(cls)
