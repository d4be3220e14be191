"""What the registry needs to load one plugin: its record, its module's declarations, and its hooks in order."""

from __future__ import annotations

import inspect
import os
import sys
import threading
import weakref
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from importlib import metadata
from types import FunctionType
from typing import Any

import pluggy

from chemage.foundation.aliases import Fields
from chemage.foundation.errors import InputError, PluginError, nearest
from chemage.plugins.hooks import BOTTOM, TOP, Stage

#: the distribution whose kinds are built in
OWN = "chemage"


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
    #: of what :data:`chemage.plugins.hooks.OFFERED` names: name -> target
    offered: dict[str, dict[str, str]] = field(default_factory=dict)
    #: why it was skipped, in words; empty when it works
    error: str = ""
    #: the class, where it was registered by hand
    component: Any = None
    #: ``"module:Class"`` of its options (``CHEMAGE_OPTIONS``)
    options: str = ""
    #: time its module took to import, s
    seconds: float = 0.0
    #: libraries that it names as its basis (``CHEMAGE_LIBRARIES``) -> version
    libraries: dict[str, str] = field(default_factory=dict)

    @cached_property
    def owner(self) -> str:
        """What stands before the colon where one of its kinds is qualified, as in ``grit:winkler``."""
        return OWN if self.distribution == OWN else self.name

    def own_kind(self, role: str, kind: str) -> str:
        """Its own name of ``kind``, which may be qualified; empty where it offers none of that name."""
        kinds = self.kinds.get(role, {})
        owner, _, plain = ("", "", kind) if kind in kinds else kind.partition(":")
        return plain if plain in kinds and owner in ("", self.owner) else ""

    def spelled(self, kind: str) -> str:
        """How a scene names its ``kind``, with where it is from."""
        return f'"{self.owner}:{kind}" ({self.source})'

    def brought(self, load: Callable[[str, str], Any]) -> Iterator[tuple[str, str]]:
        """The names that it brings, options included, each with what it is; ``load`` gives the class of a role and
        kind."""
        by = f"plugin {self.name!r} ({self.source})"
        for name in (self.name, self.distribution, self.module):
            yield name, by
        for role, kinds in self.kinds.items():
            for kind in kinds:
                what = f"{role} {kind!r} of {by}"
                yield from ((name, what) for name in (role, kind))
                with suppress(PluginError):
                    for option in load(role, kind).model_fields:
                        yield option, f"the option {option!r} of {what}"
        for offered in self.offered.values():
            yield from ((name, f"{name!r} of {by}") for name in offered)

    @property
    def source(self) -> str:
        """``distribution version (library version, ...)``, or the module where there is no distribution."""
        libraries = ", ".join(
            f"{name} {version}" for name, version in self.libraries.items()
        )
        return f"{self.distribution or self.module} {self.version} {f'({libraries})' if libraries else ''}".strip()


class Hooks(pluggy.PluginManager):
    """Hooks, of which those with one answer are called in the ``order`` that holds at the time of the call."""

    def __init__(self, order: Callable[[Sequence[Any]], Sequence[Any]]) -> None:
        super().__init__("chemage")
        self._order = order

    def _hookexec(
        self, hook_name: str, methods: Any, kwargs: Any, firstresult: bool
    ) -> Any:
        ordered = self._order(methods) if firstresult else methods
        return super()._hookexec(hook_name, ordered, kwargs, firstresult)


def installed(group: str) -> list[metadata.EntryPoint]:
    """The entry points of installed distributions, the first one of each name.

    Not those of what merely lies in the current folder or beside the script that runs, where Python looks for modules
    as well; unless PYTHONPATH names the folder, or chemage itself is installed nowhere else.
    """
    script = getattr(sys.modules["__main__"], "__file__", None) or ""
    named = filter(None, os.environ.get("PYTHONPATH", "").split(os.pathsep))
    lying = {*map(os.path.realpath, ("", os.path.dirname(os.path.abspath(script))))}
    lying -= {*map(os.path.realpath, named)}
    found: dict[str, list[metadata.EntryPoint]] = {}
    elsewhere = [
        folder for folder in sys.path if os.path.realpath(folder) not in lying
    ]
    for folders in (elsewhere, sys.path):
        for one in metadata.distributions(path=folders):
            if points := [
                point for point in one.entry_points if point.group == group
            ]:
                found.setdefault(one.name.lower().replace("_", "-"), points)
        if OWN in found:
            break
    return [point for points in found.values() for point in points]


@lru_cache(maxsize=128)
def _names(distribution: metadata.Distribution) -> tuple[str, str]:
    return distribution.name, distribution.version  # each reads the whole file


def origin(point: metadata.EntryPoint) -> tuple[str, str]:
    """Name and version of the distribution of an entry point; empty where it has none."""
    return _names(point.dist) if point.dist else ("", "")


def is_own(point: metadata.EntryPoint) -> bool:
    return origin(point)[0] == OWN


def selected(
    installed_points: Iterable[metadata.EntryPoint],
) -> list[metadata.EntryPoint]:
    """The entry points that ``CHEMAGE_PLUGINS`` allows: names besides chemage's own, or ``-name`` to leave out."""
    points = list(installed_points)
    words = [
        word.strip()
        for word in os.environ.get("CHEMAGE_PLUGINS", "").split(",")
        if word.strip()
    ]
    without = {word[1:] for word in words if word.startswith("-")}
    only = {word for word in words if not word.startswith("-")}
    if unknown := (without | only) - {point.name for point in points}:
        installed = ", ".join(sorted(point.name for point in points))
        raise InputError(
            f"CHEMAGE_PLUGINS names {', '.join(sorted(unknown))}, which is not installed; the plugins are {installed}"
        )

    def wanted(point: metadata.EntryPoint) -> bool:
        return point.name not in without and (
            not only or point.name in only or is_own(point)
        )

    return [point for point in points if wanted(point)]


_reading = threading.Lock()
_sources: weakref.WeakKeyDictionary[type, str] = weakref.WeakKeyDictionary()


def short_hash(text: str, size: int) -> str:
    from chemage.foundation.records import (
        text_hash,
    )  # imports numpy, which the command line can do without

    return text_hash(text, size)


def source_version(cls: type) -> str:
    """What stands for the version of a class that is not packaged: a hash of its source, which is read once."""
    with _reading:  # Python 3.11 cannot parse in two threads at once
        if cls not in _sources:
            try:
                text = inspect.getsource(cls)
            except (OSError, TypeError):
                _sources[cls] = "(source unknown)"
            else:
                _sources[cls] = f"(source {short_hash(text, 4)})"
        return _sources[cls]


def full_name(record: PluginRecord) -> str:
    return f"{record.name} ({record.source})"


def versions(libraries: Any) -> dict[str, str]:
    """The versions of the distributions that a plugin names as its basis."""
    if isinstance(libraries, str) or not all(
        isinstance(name, str) for name in libraries
    ):
        raise PluginError(
            f"CHEMAGE_LIBRARIES = {libraries!r}: give a tuple of names of distributions"
        )
    return {name: metadata.version(name) for name in libraries}


def add_specifications(manager: pluggy.PluginManager, room: Any) -> None:
    """Add the hooks that a room specifies, if it does."""
    if any(
        getattr(function, "chemage_spec", None) for function in vars(room).values()
    ):
        manager.add_hookspecs(room)


def checked_stages(
    plugin: Any, there: Sequence[Stage], roles: Mapping[str, str]
) -> tuple[Any, Mapping[str, str]]:
    """The stages and roles that the module of a plugin declares (``STAGES``, ``ROLES``), beside those ``there``.

    Raises
    ------
    PluginError
        A name is taken, or a stage is not complete.
    """
    stages, own = getattr(plugin, "STAGES", ()), getattr(plugin, "ROLES", {})
    if taken := roles.keys() & own.keys():
        raise PluginError(
            f"ROLES: there is a role {min(taken)!r} already; choose another name"
        )
    sections = {*TOP, *BOTTOM, *(name for stage in there for name in stage.roles)}
    made = {stage.makes for stage in there if stage.makes}
    for stage in stages:
        if not isinstance(stage, Stage):
            raise PluginError(f"STAGES: {stage!r} is no chemage.plugin.Stage")
        where = f"STAGES: [{stage.section}]:"
        if stage.section in sections or not stage.section.isidentifier():
            raise PluginError(
                f"{where} this name is taken, or none; choose another"
            )
        sections.add(stage.section)
        if stage.role and stage.role not in {**roles, **own}:
            raise PluginError(
                f"{where} there is no role {stage.role!r}; declare it in ROLES"
            )
        if unknown := [
            name
            for name in (*stage.takes, stage.makes)
            if name and name not in made
        ]:
            raise PluginError(
                f"{where} nothing makes {unknown[0]!r}; there are {', '.join(sorted(made))}"
            )
        if stage.makes and not stage.changes:
            raise PluginError(
                f"{where} a plugin's stage changes what it makes; add takes = ({stage.makes!r},)"
            )
    return stages, own


def is_stage(hook: Any) -> bool:
    return hook.spec is not None and bool(hook.spec.opts["firstresult"])


def check_hook_names(plugin: Any, hooks: list[str]) -> None:
    """Refuse what pluggy would silently ignore: a misspelled or unmarked hook, or no hook at all."""
    count = 0
    for name in dir(plugin):
        function = getattr(plugin, name)
        marked = getattr(function, "chemage_impl", None)
        if not callable(function) or (
            marked is None and not name.startswith("chemage_")
        ):
            continue
        hook = (marked or {}).get("specname") or name
        if hook not in hooks:
            raise PluginError(
                f"implements {hook}, which is not a hook{nearest(hook, hooks)}; the hooks are {', '.join(hooks)}"
            )
        if marked is None:
            raise PluginError(
                f"{name} is not marked as a hook; write @chemage.plugin.hookimpl above it"
            )
        count += 1
    if not count:
        raise PluginError(f"implements no hook; the hooks are {', '.join(hooks)}")


def clash(role: str, kind: str, offers: list[PluginRecord]) -> str:
    return (
        f"{role} {kind!r} is claimed by {' and by '.join(f'{r.name!r} ({r.source})' for r in offers)}; "
        "uninstall one of them"
    )


def checked_targets(where: str, targets: Any) -> dict[str, str]:
    if not isinstance(targets, Mapping):
        raise PluginError(
            f"{where}: expected {{name: 'module:thing'}}, got {targets!r}"
        )
    for name, target in targets.items():
        if (
            not isinstance(name, str)
            or not isinstance(target, str)
            or target.count(":") != 1
        ):
            raise PluginError(
                f"{where} {name!r}: expected 'module:thing', got {target!r}"
            )
    return dict(targets)


def checked_kinds(
    offer: Any, roles: Mapping[str, str]
) -> dict[str, dict[str, str]]:
    """What ``chemage_register`` of a plugin gave, which must be kinds of the ``roles``."""
    if not isinstance(offer, Mapping):
        raise PluginError(
            f"chemage_register gave {offer!r}; expected {{role: {{kind: 'module:Class'}}}}"
        )
    if unknown := [role for role in offer if role not in roles]:
        raise PluginError(
            f"chemage_register names the role {unknown[0]!r}; the roles are {', '.join(roles)}"
        )
    return {
        role: checked_targets(f"chemage_register: {role}", targets)
        for role, targets in offer.items()
    }


def checked_class(cls: Any, role: type, kind: str, record: PluginRecord) -> Any:
    """The class of a component, which must be complete, of the class ``role``, and usable as that is."""
    name: str = role.role  # pyright: ignore[reportAttributeAccessIssue]
    target = record.kinds[name][kind]
    where = f"{name} {kind!r} of plugin {record.name!r} ({record.source})"
    if not (isinstance(cls, type) and issubclass(cls, role)):
        raise PluginError(
            f"{where}: {target} is not a chemage.plugin.{role.__name__}"
        )
    if cls.kind != kind:  # pyright: ignore[reportAttributeAccessIssue]
        raise PluginError(
            f"{where}: the class calls itself {cls.kind!r}; set kind = {kind!r}"
        )
    if abstract := getattr(cls, "__abstractmethods__", None):
        raise PluginError(
            f"{where}: {target} does not define {', '.join(sorted(abstract))}"
        )
    # an option hides the method of its name
    if hidden := [
        option
        for option in cls.model_fields
        if callable(getattr(role, option, None))
    ]:  # pyright: ignore[reportAttributeAccessIssue]
        raise PluginError(
            f"{where}: the option {hidden[0]!r} has the name of a method of its role; rename it"
        )
    check_signatures(cls, role, where)
    return cls


def scene_text(target: str) -> str:
    """The text of a shipped scene or material, ``"package:file.toml"``."""
    from importlib import resources

    package, _, name = target.partition(":")
    return resources.files(package).joinpath(name).read_text(encoding="utf-8")


def trace_before(hook_name: str, methods: Any, kwargs: Fields) -> None:
    print(
        f"chemage hook {hook_name}({', '.join(kwargs)}) -> {[m.plugin_name for m in methods]}",
        file=sys.stderr,
    )


def trace_after(outcome: Any, hook_name: str, methods: Any, kwargs: Fields) -> None:
    print(f"chemage hook {hook_name} done", file=sys.stderr)


def checked_options(target: Any, record: PluginRecord) -> str:
    """What a module gives as ``CHEMAGE_OPTIONS``."""
    if not target:
        return ""
    if record.name == "prefer":
        raise PluginError(
            "a plugin with options cannot be called 'prefer', which is an entry of [plugins]"
        )
    return checked_targets("CHEMAGE_OPTIONS", {"": target})[""]


def check_signatures(cls: type, role: type, where: str) -> None:
    """Raise a PluginError if chemage cannot call a method of ``cls`` as it calls that of its ``role``.

    The arguments that a role's method takes by position are passed to all components, those it takes by name only to
    components that name them.
    """
    for base in role.__mro__:
        if not base.__module__.startswith("chemage."):
            continue
        for name, expected in vars(base).items():
            method = inspect.getattr_static(cls, name, expected)
            if name.startswith("__") or method is expected:
                continue
            of_class = isinstance(expected, classmethod)
            if of_class and inspect.isfunction(method):
                raise PluginError(
                    f"{where}: {name} is called on the class; write @classmethod above it"
                )
            wanted = classmethod if of_class else FunctionType
            if not (isinstance(expected, wanted) and isinstance(method, wanted)):
                continue
            functions: Any = [
                getattr(each, "__func__", each) for each in (expected, method)
            ]
            expected, method = functions
            parameters = inspect.signature(expected).parameters.values()
            needed = [
                parameter
                for parameter in parameters
                if parameter.kind
                in (parameter.POSITIONAL_ONLY, parameter.POSITIONAL_OR_KEYWORD)
            ]
            try:
                inspect.signature(method).bind(*needed)
            except TypeError as error:
                call = ", ".join(parameter.name for parameter in needed[1:])
                raise PluginError(
                    f"{where}: {cls.__name__}.{name}{inspect.signature(method)} cannot be called as "
                    f"{name}({call}): {error}"
                ) from None


def called(hook: Any, plugin: Any) -> Any:
    """What one plugin answers to a hook without arguments."""
    return next(
        impl.function() for impl in hook.get_hookimpls() if impl.plugin is plugin
    )
