"""The registry: finds plugins, loads a component on first use, and explains what is wrong.

Nothing heavy happens here: an entry point's module is imported (light by contract), its ``chemage_register`` strings
are kept, and the class behind a kind is imported when it is first used. A broken plugin is recorded and skipped;
with ``CHEMAGE_STRICT=1`` it raises. ``CHEMAGE_PLUGINS=-name`` leaves a plugin out, ``CHEMAGE_PLUGINS=name,other`` uses
just these besides chemage's own. ``CHEMAGE_TRACE=1`` prints every hook call to stderr.

Several plugins that implement the hook of a stage are asked in this order, and as wrappers the first has the last
word: those that the scene, a block or ``CHEMAGE_PREFER`` prefers; registered by hand, the latest first; installed, by
name; chemage itself.

Of several plugins with one kind, that which the scene, a block or ``CHEMAGE_PREFER`` prefers is meant by ``winkler``,
else chemage itself; ``grit:winkler`` is that of the plugin ``grit`` in any case, ``chemage:winkler`` what is built in.
Data that chemage writes qualify every kind that is not built in.
"""

from __future__ import annotations

import importlib
import os
import threading
import time
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from importlib import metadata
from pkgutil import resolve_name
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar

from chemage.foundation import limits, names, ownership
from chemage.foundation.aliases import Fields
from chemage.foundation.errors import (
    InputError,
    PluginError,
    UnknownKindError,
    imported,
    nearest,
)
from chemage.plugins import context, hooks
from chemage.plugins.context import (
    Plugins,
    TakingPart,
    record_participation,
    taking_part,
)
from chemage.plugins.hooks import Stage, in_order
from chemage.plugins.loading import (
    OWN,
    Hooks,
    PluginRecord,
    PluginWarning,
    add_specifications,
    called,
    check_hook_names,
    checked_class,
    checked_kinds,
    checked_options,
    checked_stages,
    checked_targets,
    clash,
    full_name,
    installed,
    is_own,
    is_stage,
    origin,
    scene_text,
    selected,
    short_hash,
    source_version,
    trace_after,
    trace_before,
    versions,
)

if TYPE_CHECKING:
    from chemage.foundation.outputs import Block

__all__ = [
    "PluginRecord",
    "PluginWarning",
    "Registry",
    "scene_text",
    "source_version",
]

GROUP = "chemage"
#: modules in which the rooms of chemage declare roles (``ROLES``), stages (``STAGES``), hooks, answers (``ANSWERS``)
ROOMS = (
    "chemage.plugins.hooks",
    "chemage.surfaces.hooks",
    "chemage.contacts.hooks",
    "chemage.lattices.hooks",
    "chemage.kinetics.hooks",
    "chemage.friction.hooks",
    "chemage.ageing.hooks",
    "chemage.scene.hooks",
)
#: time of import from which a module is called slow, s
SLOW = 0.5
T = TypeVar("T")
#: name of each plugin, and its distribution with the version
InUse: TypeAlias = tuple[tuple[str, str], ...]


class Registry:
    """One set of plugins; :func:`current` gives the one in use."""

    def __init__(
        self,
        entry_points: Iterable[metadata.EntryPoint] | None = None,
        *,
        strict: bool | None = None,
    ) -> None:
        self.strict = (
            os.environ.get("CHEMAGE_STRICT", "") not in ("", "0")
            if strict is None
            else strict
        )
        self.manager = Hooks(self._in_order)
        if os.environ.get("CHEMAGE_TRACE", "") not in ("", "0"):
            self.manager.add_hookcall_monitoring(trace_before, trace_after)
        self.records: list[PluginRecord] = []
        #: those with hooks, by the name that these have
        self._with_hooks: dict[str, PluginRecord] = {}
        self.roles: dict[
            str, str
        ] = {}  # role -> "module:Class" of its abstract class
        self.rooms: list[Any] = []  # modules that declare roles, stages and hooks
        self.owners: dict[
            str, PluginRecord
        ] = {}  # section -> the plugin whose stage it is
        self._stages: list[Stage] | None = None
        self._stage_hooks: list[str] | None = None
        #: the plugin's full name, role and kind -> class
        self._classes: dict[tuple[str, str, str], type] = {}
        for name in ROOMS:
            self.add_room(importlib.import_module(name))
        points = (
            selected(installed(GROUP)) if entry_points is None else entry_points
        )
        # by name: the order never depends on the file system; pluggy asks those first that were registered last
        for point in sorted(
            points, key=lambda p: (is_own(p), p.name), reverse=True
        ):
            self._load(point)
        self.records.sort(
            key=lambda record: (
                record.owner != OWN,
                record.name,
                record.distribution,
            )
        )
        for record in self.records:
            if record.error:
                warnings.warn(
                    f"plugin {record.name!r} ({record.source}) was skipped: {record.error}",
                    PluginWarning,
                    stacklevel=2,
                )

    def add_room(self, room: Any) -> None:
        """Add what a module declares: roles (``ROLES``), stages (``STAGES``), hooks and own answers (``ANSWERS``)."""
        self.rooms.append(room)
        add_specifications(self.manager, room)
        if (answers := getattr(room, "ANSWERS", None)) is not None:
            self._attach(answers(), room.__name__.removesuffix(".hooks"))
        self.roles |= getattr(room, "ROLES", {})
        self._stages = self._stage_hooks = None

    def stages(self) -> list[Stage]:
        """What the rooms declare of their stages, each after those that it rests on."""
        if self._stages is None:
            self._stages = in_order(
                stage
                for room in self.rooms
                for stage in getattr(room, "STAGES", ())
            )
        return self._stages

    def _load(self, point: metadata.EntryPoint) -> None:
        record = PluginRecord(point.name, *origin(point), point.value)
        self.records.append(record)
        try:
            begin = time.perf_counter()
            plugin = point.load()
            record.seconds = time.perf_counter() - begin
            self._register(plugin, record)
        except (
            Exception,
            SystemExit,
        ) as error:  # a plugin that exits when imported must not end the program
            if self.strict:
                raise PluginError(
                    f"plugin {record.name!r} ({record.source}): {type(error).__name__}: {error}"
                ) from error
            record.error = f"{type(error).__name__}: {error}"

    def register(self, plugin: Any, name: str) -> PluginRecord:
        """Add a plugin by hand (a module or any object with hook implementations); a broken one raises."""
        record = PluginRecord(
            name, "", "", getattr(plugin, "__name__", type(plugin).__name__)
        )
        try:
            self._register(plugin, record)
        except Exception as error:
            raise PluginError(
                f"plugin {name!r}: {type(error).__name__}: {error}"
            ) from error
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
            raise PluginError(
                f"{cls!r} is no component with a role and a kind; subclass a role such as chemage.plugin.Engine"
            )
        name = f"{cls.__module__}.{cls.__qualname__}"
        self.records = [record for record in self.records if record.name != name]
        record = PluginRecord(
            name,
            "",
            source_version(cls),
            cls.__module__,
            {role: {kind: name}},
            component=cls,
        )
        if others := self.offers(role, kind):
            raise PluginError(clash(role, kind, [*others, record]))
        checked_class(cls, self.role(role), kind, record)
        self.records.append(record)
        return record

    def unregister_class(self, cls: Any) -> None:
        """The inverse of :meth:`register_class`."""
        self.records = [
            record for record in self.records if record.component is not cls
        ]

    def _register(self, plugin: Any, record: PluginRecord) -> None:
        api = getattr(plugin, "CHEMAGE_API", hooks.API_VERSION)
        if api not in hooks.SUPPORTED_API_VERSIONS:
            raise PluginError(
                f"made for plugin interface {api}, this chemage has {hooks.API_VERSION}"
            )
        record.libraries = versions(getattr(plugin, "CHEMAGE_LIBRARIES", ()))
        record.options = checked_options(
            getattr(plugin, "CHEMAGE_OPTIONS", ""), record
        )
        name = full_name(record)
        if self.manager.has_plugin(name) or self.manager.is_registered(plugin):
            raise PluginError(f"{record.module} is registered twice")
        stages, roles = checked_stages(plugin, self.stages(), self.roles)
        if not stages:
            check_hook_names(plugin, self._hook_names())
        try:
            self._attach(plugin, name, record)
            for hook in self.manager.get_hookcallers(plugin) or ():
                if hook.name == "chemage_register":
                    record.kinds = checked_kinds(
                        called(hook, plugin), {**self.roles, **roles}
                    )
                elif (what := hook.name.removeprefix("chemage_")) in hooks.OFFERED:
                    record.offered[what] = checked_targets(
                        hook.name, called(hook, plugin)
                    )
        except (Exception, SystemExit):
            # older pluggy keeps the hooks that come before the one at fault
            if self.manager.is_registered(plugin):
                self.manager.unregister(plugin)
            record.kinds, record.offered, record.options = {}, {}, ""
            raise
        self._with_hooks[name] = record
        if stages or roles:
            self.add_room(plugin)
            self.owners |= {stage.section: record for stage in stages}

    def _attach(
        self, plugin: Any, name: str, record: PluginRecord | None = None
    ) -> None:
        """Add the hooks of a plugin, so that their part in an answer is noted; those of a room have no ``record``."""
        self.manager.register(plugin, name)
        for hook in self.manager.get_hookcallers(plugin) or ():
            if hook.name not in hooks.OFFERS:
                for impl in hook.get_hookimpls():
                    if impl.plugin is plugin:
                        record_participation(impl, hook, record, self.source_in_use)

    def _hook_names(self) -> list[str]:
        return [
            name for name in dir(self.manager.hook) if name.startswith("chemage_")
        ]

    # -- stages -------------------------------------------------------------------------------------------------------

    def answer(
        self, hook: str, expected: type[T], **arguments: Any
    ) -> tuple[T, TakingPart, Block]:
        """Call the hook of a stage: its answer, the plugins that answered or changed it, and what was recorded meanwhile
        (:mod:`chemage.foundation.outputs`).

        Raises
        ------
        PluginError
            Names the plugin or component that gave something else than ``expected``, or a :meth:`Stage.fault`.
        """
        from chemage.foundation.outputs import (
            recording,
        )  # imports numpy, which the command line can do without

        stage = next(
            (stage for stage in self.stages() if hook in stage.hooks), None
        )

        self.check_preference(context.preference(), "the preference of plugins")

        def check(answer: Any, who: str) -> None:
            # without a plugin, the method of a component answers
            parts = () if who else arguments.values()
            component = next(
                (one for one in parts if getattr(one, "role", "")), None
            )
            there = recorded.keys() | getattr(answer, "observables", {}).keys()
            problem = ""
            if missing := getattr(component, "outputs", {}).keys() - there:
                problem = (
                    f" declares the output {min(missing)!r} and does not record it"
                )
            elif not isinstance(answer, expected):
                problem = f" answered {hook} with {type(answer).__name__}; expected {expected.__name__} or None"
            elif stage is not None and (fault := stage.fault(answer, arguments)):
                problem = f": {hook}: {fault}"
            if problem:
                raise PluginError((who or self._named(component)) + problem)

        with recording() as recorded, taking_part(check) as took_part:
            result = getattr(self.manager.hook, hook)(**arguments)
        return result, took_part, recorded

    def _named(self, component: Any) -> str:
        """A component with the plugin that provides it."""
        if component is None:
            return "chemage"
        cls = type(component)
        return (
            f"{component.role} {component.kind!r} of {self.owner(cls) or 'chemage'}"
        )

    def owner(self, code: Any) -> str:
        """The plugin that a class or a function is from, in words; "" for chemage's own."""
        package = code.__module__.partition(".")[0]
        record = self.provider(code) if isinstance(code, type) else None
        record = record or next(
            (
                each
                for each in self.records
                if each.component is None
                and each.module.partition(":")[0].partition(".")[0] == package
            ),
            None,
        )
        if package == "chemage" or (record and record.distribution == "chemage"):
            return ""
        if record is not None and record.component is None:
            return f"plugin {record.name!r} ({record.source})"
        return (
            f"{code.__module__}.{code.__qualname__} {source_version(code)}".strip()
        )

    def check_preference(self, names: Iterable[str], where: str) -> None:
        """Raise an InputError if one of these plugins, named in ``where``, is not in use."""
        in_use = [record.name for record in self.records if not record.error]
        if unknown := [name for name in names if name not in in_use]:
            hint = nearest(unknown[0], in_use) if len(unknown) == 1 else ""
            raise InputError(
                f"{where} names {', '.join(map(repr, unknown))}, which is not installed{hint}; "
                f"the plugins are {', '.join(sorted(in_use))}"
            )

    def _in_order(self, implementations: Sequence[Any]) -> list[Any]:
        """Implementations of a hook as pluggy has them, the first one last, with those of preferred plugins first."""
        preferred = context.preference()
        if not preferred:
            return list(implementations)
        ranks = {
            name: -preferred.index(record.name)
            for name, record in self._with_hooks.items()
            if record.name in preferred
        }
        others = -len(preferred)
        return sorted(
            implementations,
            key=lambda each: (each.wrapper, ranks.get(each.plugin_name, others)),
        )

    def implementing(self, *hook_names: str) -> Plugins:
        """The plugins, other than chemage's own rooms, that implement any of these hooks: name -> source, sorted."""
        records = {
            record.name: record
            for hook in hook_names
            for record, _ in self.functions(hook)
        }
        return {
            name: self.source_in_use(record)
            for name, record in sorted(records.items())
        }

    def functions(self, hook: str) -> list[tuple[PluginRecord, Any]]:
        """Each plugin that implements ``hook``, with its function, sorted by the name of the plugin."""
        found = [
            (self._with_hooks[each.plugin_name], each.function)
            for each in getattr(self.manager.hook, hook).get_hookimpls()
            if each.plugin_name in self._with_hooks
        ]
        return sorted(found, key=lambda one: one[0].name)

    def implementation(self, name: str) -> Any:
        """The module or object with the hooks of the plugin ``name``."""
        return self.manager.get_plugin(
            next(
                full_name(record) for record in self.records if record.name == name
            )
        )

    def state(self) -> str:
        """A hash of all plugins with their versions."""
        return short_hash(
            "\n".join(
                sorted(
                    f"{each.name} {each.source} {each.error}"
                    for each in self.records
                )
            ),
            8,
        )

    def installed(self) -> InUse:
        """The plugins in use that were not registered by hand."""
        return tuple(
            (each.name, f"{each.distribution} {each.version}")
            for each in self.records
            if each.distribution and not each.error
        )

    def source(self, name: str) -> str | None:
        """The source of the plugin ``name``, with its version and the options in use; None if it is not in use."""
        record = next(
            (each for each in self.records if each.name == name and not each.error),
            None,
        )
        return None if record is None else self.source_in_use(record)

    def source_in_use(self, record: PluginRecord) -> str:
        """The source of a plugin with its version and, in square brackets, its options in use."""
        if not record.options:
            return record.source
        try:
            options = (
                context.options().get(record.name)
                or self.options_class(record.name)()
            )
        except (PluginError, InputError):
            return record.source  # a hook that reads them raises this error
        return f"{record.source} [{options.text()}]"

    def options_class(self, name: str) -> Any:
        """The class of the options of the plugin ``name``.

        Raises
        ------
        InputError
            There is no such plugin, or it has no options.
        PluginError
            The class cannot be imported, or is not as it must be.
        """
        record = next((each for each in self.records if each.name == name), None)
        with_options = [each.name for each in self.records if each.options]
        hint = f"; plugins with options: {', '.join(with_options) or 'none'}"
        if record is None:
            near = nearest(name, with_options)
            raise InputError(f"no plugin {name!r}{near} is installed{hint}")
        if record.error:
            raise InputError(f"plugin {name!r} was skipped: {record.error}")
        if not record.options:
            raise InputError(f"plugin {name!r} has no options{hint}")
        where = f"the options of plugin {record.name!r} ({record.source})"
        cls = imported(record.options, where)
        # known by its methods, because the module of the base imports this one
        if not (
            isinstance(cls, type)
            and hasattr(cls, "changed")
            and hasattr(cls, "current")
        ):
            raise PluginError(
                f"{where}: {record.options} is not a chemage.plugin.PluginOptions"
            )
        if required := [
            option
            for option, info in cls.model_fields.items()
            if info.is_required()
        ]:
            raise PluginError(
                f"{where}: {', '.join(required)} must have a default, for scenes that do not set it"
            )
        return cls

    def provider(self, cls: type) -> PluginRecord | None:
        """The plugin whose component ``cls`` is; None for a class that is not registered."""
        role, kind = getattr(cls, "role", ""), getattr(cls, "kind", "")
        for record in self.records:
            offered = record.kinds.get(role, {}).get(kind)
            if offered is not None and (
                record.component is cls
                or offered == f"{cls.__module__}:{cls.__qualname__}"
                # imported, perhaps under another path than its own
                or self._classes.get((full_name(record), role, kind)) is cls
            ):
                return record
        return None

    def stage_hooks(self) -> list[str]:
        """The hooks of which one answer is used: those of the stages."""
        if self._stage_hooks is None:
            self._stage_hooks = [
                name
                for name in self._hook_names()
                if is_stage(getattr(self.manager.hook, name))
            ]
        return self._stage_hooks

    # -- components ---------------------------------------------------------------------------------------------------

    def kinds(self, role: str) -> list[str]:
        """Kinds installed for ``role``, sorted, each qualified where it is not meant otherwise."""
        return sorted(
            {
                kind
                if self._meant(self.offers(role, kind)) == [record]
                else f"{record.owner}:{kind}"
                for record in self.records
                for kind in record.kinds.get(role, ())
            }
        )

    def _offered(self) -> Iterator[tuple[PluginRecord, str, str]]:
        """Each plugin with the roles and kinds that it has."""
        for record in self.records:
            for role, kinds in record.kinds.items():
                yield from ((record, role, kind) for kind in kinds)

    def offers(self, role: str, kind: str) -> list[PluginRecord]:
        """The plugins that have ``kind``, qualified or not."""
        qualified = ":" in kind
        return [
            record
            for record in self.records
            if kind in record.kinds.get(role, ())
            or (qualified and record.own_kind(role, kind))
        ]

    def first(
        self, offers: Iterable[PluginRecord]
    ) -> tuple[list[PluginRecord], str]:
        """Those of the plugins that come first where any of them will do, and why: the preferred one, else chemage's
        own, so that no result changes when a plugin is installed; else all.

        Raises
        ------
        InputError
            A plugin that is not in use is preferred.
        """
        offers, preferred = list(offers), context.preference()
        self.check_preference(preferred, "the preference of plugins")
        for name in preferred:
            if found := [record for record in offers if record.name == name]:
                return found, "its plugin is preferred"
        own = [record for record in offers if record.owner == OWN]
        return (own, "it comes with chemage") if own else (offers, "")

    def _meant(self, offers: list[PluginRecord]) -> list[PluginRecord]:
        return self.first(offers)[0] if len(offers) > 1 else offers

    def offer(self, role: str, kind: str) -> PluginRecord:
        """The plugin whose ``kind`` is meant, qualified or not.

        Raises
        ------
        UnknownKindError
            Nothing installed has it; the message lists what is and suggests the nearest.
        InputError
            Several plugins have it and none comes first; the message names them as a scene does.
        PluginError
            Two plugins of one name have it.
        """
        offers = self._meant(self.offers(role, kind))
        if not offers:
            raise UnknownKindError(self._unknown(role, kind))
        if len(offers) == 1:
            return offers[0]
        if len({record.owner for record in offers}) == 1:
            raise PluginError(clash(role, kind, offers))
        spelled = " or ".join(record.spelled(kind) for record in offers)
        raise InputError(
            f"{len(offers)} plugins have a {role} {kind!r}; write {spelled}, or prefer one of them"
        )

    def _unknown(self, role: str, kind: str) -> str:
        owner, _, plain = kind.rpartition(":")
        if owner and owner not in {record.owner for record in self.records}:
            installed = self.offers(role, plain)
            return f"{role} {kind!r}: no plugin {owner!r} is installed" + "".join(
                f"; there is {record.spelled(plain)}" for record in installed
            )
        installed = self.kinds(role)
        broken = [record.name for record in self.records if record.error]
        return (
            f"no {role} {kind!r}{nearest(kind, installed)}; installed: {', '.join(installed) or 'none'}"
            + (f" (skipped because broken: {', '.join(broken)})" if broken else "")
        )

    def clashes(self) -> list[str]:
        """A sentence for each kind, scene and name of a plugin that is claimed more than once, so that no spelling
        selects one."""
        qualified = dict.fromkeys(
            (role, f"{record.owner}:{kind}")
            for record, role, kind in self._offered()
        )
        claims = [(*claim, self.offers(*claim)) for claim in qualified]
        for what, one in hooks.OFFERED.items():
            claims += [
                (one, name, self._offering(what, name))
                for name in self.offered(what)
            ]
        called = {
            record.name: [each for each in self.records if each.name == record.name]
            for record in self.records
        }
        claims += [("the name", name, records) for name, records in called.items()]
        return [clash(*claim) for claim in claims if len(claim[2]) > 1]

    def component(self, role: str, kind: str) -> Any:
        """The class behind ``kind``.

        Raises
        ------
        UnknownKindError, InputError
            See :meth:`offer`.
        PluginError
            See :meth:`offer`; or the class cannot be imported or is not of that role.
        """
        self.role(role)
        record = self.offer(role, kind)
        if record.component is not None:
            return record.component
        kind = record.own_kind(role, kind)
        place = full_name(record), role, kind
        if place not in self._classes:
            self._classes[place] = self._import(role, kind, record)
        return self._classes[place]

    def usable(self, role: str) -> Iterator[tuple[str, Any]]:
        """Each kind of a role with its class; of one that cannot be used a warning says why."""
        for kind in self.kinds(role):
            try:
                yield kind, self.component(role, kind)
            except PluginError as error:
                warnings.warn(f"left out: {error}", PluginWarning, stacklevel=3)

    def role(self, name: str) -> Any:
        """The abstract class of a role; InputError if there is none."""
        if name not in self.roles:
            raise InputError(
                f"no such role {name!r}; the roles are {', '.join(self.roles)}"
            )
        return imported(self.roles[name])

    def make(self, role: str, kind: str, options: Fields) -> Any:
        """The component ``kind`` with ``options``."""
        return self.component(role, kind)(**options)

    def fromdict(self, role: str, fields: Fields) -> Any:
        """A component from its ``todict()``, which no preference reads otherwise."""
        with context.applied(context.options(), ()):
            return self.fromtable(role, fields)

    def fromtable(self, role: str, fields: Fields) -> Any:
        """A component from a table with its ``kind`` and options, as a user writes it."""
        if not isinstance(fields, Mapping) or not all(
            isinstance(name, str) for name in fields
        ):
            raise InputError.of(
                "fields", fields, "is not a table of options by name"
            )
        options = dict(fields)
        if "kind" not in options:
            raise InputError(
                f"{role}: kind is required; installed: {', '.join(self.kinds(role)) or 'none'}"
            )
        return self.make(role, options.pop("kind"), options)

    def brought(self) -> Iterator[tuple[str, str]]:
        """The names of what is not chemage's own, sections and options included, each with what it is and of which
        plugin."""
        for section, record in self.owners.items():
            yield (
                section,
                f"[{section}] of plugin {record.name!r} ({record.source})",
            )
        for record in self.records:
            if record.owner == OWN or record.error:
                continue
            yield from record.brought(partial(self._import, record=record))

    def scenes(self) -> dict[str, str]:
        """Installed scenes: name -> ``"package:file"``."""
        return self.offered("scenes")

    def materials(self) -> dict[str, str]:
        """Installed materials: name -> ``"package:file"``."""
        return self.offered("materials")

    def offered(self, what: str) -> dict[str, str]:
        """All that :data:`chemage.plugins.hooks.OFFERED` has under ``what``: name -> target."""
        return {
            name: target
            for record in self.records
            for name, target in record.offered.get(what, {}).items()
        }

    def _offering(self, what: str, name: str) -> list[PluginRecord]:
        return [
            record
            for record in self.records
            if name in record.offered.get(what, {})
        ]

    def target(self, what: str, name: str) -> tuple[PluginRecord, str]:
        """The plugin that offers ``name``, and its target; two such plugins are an error."""
        holders = self._offering(what, name)
        if len(holders) > 1:
            raise PluginError(clash(hooks.OFFERED[what], name, holders))
        return holders[0], holders[0].offered[what][name]

    def check(self) -> list[str]:
        """Everything that is wrong, a sentence each: broken plugins, clashes, what cannot be imported or called."""
        problems = [
            f"plugin {r.name!r} ({r.source}): {r.error}"
            for r in self.records
            if r.error
        ]
        problems += self.clashes()
        for record in self.records:
            if record.options:
                try:
                    self.options_class(record.name)
                except PluginError as error:
                    problems.append(str(error))
            for role, kinds in record.kinds.items():
                for kind in kinds:
                    try:
                        self._import(role, kind, record)
                    except PluginError as error:
                        problems.append(str(error))
            for what, read in (
                ("scenes", scene_text),
                ("results", resolve_name),
                ("names", resolve_name),
            ):
                for name, target in record.offered.get(what, {}).items():
                    try:
                        read(target)
                    except Exception as error:
                        problems.append(
                            f"{hooks.OFFERED[what]} {name!r} of plugin {record.name!r}: {target}: {error}"
                        )
        return problems

    def notes(self) -> list[str]:
        """What to know although nothing is wrong, a sentence each: slow imports, stages that plugins share."""
        said = [
            f"plugin {record.name!r} ({record.source}): its module {record.module} takes {record.seconds:.1f} s to "
            "import, which every command waits for; import what is slow inside functions, or in the modules that the "
            "registered strings name"
            for record in self.records
            if record.seconds > SLOW
        ]
        said += self._shared_kinds()
        records = self._with_hooks
        for name in self.stage_hooks():
            ordered = self._in_order(
                getattr(self.manager.hook, name).get_hookimpls()
            )
            for wraps, verb, wins in (
                (False, "answer", "is asked first"),
                (True, "wrap", "has the last word"),
            ):
                sharing = [
                    records[each.plugin_name]
                    for each in reversed(ordered)
                    if each.wrapper == wraps and each.plugin_name in records
                ]
                if len(sharing) > 1:
                    listed = " and ".join(
                        f"{each.name!r} ({each.source})" for each in sharing
                    )
                    how = prefer_another(sharing[1].name)
                    said.append(
                        f"{listed} {verb} {name}; {sharing[0].name!r} {wins}; to change this, {how}"
                    )
        return said

    def _shared_kinds(self) -> Iterator[str]:
        """A sentence for each kind that several plugins have."""
        for role, kind in dict.fromkeys(
            (role, kind) for _, role, kind in self._offered()
        ):
            offers = self.offers(role, kind)
            if len({record.owner for record in offers}) > 1:
                spelled = " and ".join(record.spelled(kind) for record in offers)
                first, why = self.first(offers)
                yield f"{role} {kind!r} may be {spelled}; " + (
                    f'without a plugin, it is "{first[0].owner}:{kind}", because {why}'
                    if why
                    else "a scene must say which"
                )

    def _import(self, role: str, kind: str, record: PluginRecord) -> Any:
        if record.component is not None:
            return record.component
        cls = imported(
            record.kinds[role][kind],
            f"{role} {kind!r} of plugin {record.name!r} ({record.source})",
        )
        return checked_class(cls, self.role(role), kind, record)


ownership.plugin_of = lambda code: "" if _finding else current().owner(code)


def prefer_another(name: str) -> str:
    """How a user changes the order of plugins."""
    return f'write prefer = ["{name}"] below [plugins] in the scene, or set {context.PREFER}={name}'


_current: Registry | None = None
_discovery = threading.RLock()
#: whether the thread that holds the lock is finding plugins
_finding = False


def current() -> Registry:
    """The registry in use; plugins are discovered on the first call."""
    global _current, _finding
    if _current is None:
        with _discovery:
            if _finding:
                raise PluginError(
                    "a plugin asks for other plugins while it is imported; do so inside a function"
                )
            if _current is None:
                _finding = True
                try:
                    _current = Registry()
                finally:
                    _finding = False
    return _current


def use_only(plugins: InUse) -> None:
    """Use the installed plugins of the process that started this one, and no other.

    Raises
    ------
    PluginError
        One of them is not installed here in that version, or does not work.
    """
    global _current
    with _discovery:
        if _current is not None and _current.installed() == plugins:
            return
        points = {
            (point.name, " ".join(origin(point))): point
            for point in installed(GROUP)
        }
        if missing := [one for one in plugins if one not in points]:
            name, source = missing[0]
            others = ", ".join(other for known, other in points if known == name)
            raise PluginError(
                f"the plugin {name!r} ({source}) is not installed in this process{f', but {others}' if others else ''}; "
                "install the same version where the workers run"
            )
        _current = Registry([points[one] for one in plugins], strict=True)


def stages() -> list[Stage]:
    """The stages of a scene, of chemage and of the plugins in use, each after those that it rests on."""
    return (_current or current()).stages()


def named(name: str) -> Any:
    """What a plugin brings to ``chemage`` under this name; AttributeError if none does."""
    with _discovery:
        known = (
            {} if _finding or name.startswith("_") else current().offered("names")
        )
    if name not in known:
        raise AttributeError(f"module 'chemage' has no attribute {name!r}")
    return names.load(name, current().target("names", name)[1])


@contextmanager
def using(registry: Registry) -> Iterator[Registry]:
    """Use another registry within a block (for tests of plugins)."""
    global _current
    before, _current = _current, registry
    try:
        yield registry
    finally:
        _current = before


def fromdict(role: str, fields: Fields) -> Any:
    """A component from its ``todict()``."""
    return current().fromdict(role, fields)


def _spelling(cls: Any, everywhere: bool) -> str:
    with _discovery:
        if _finding:  # nothing is registered yet
            return cls.kind
    plugins = _current or current()
    record = plugins.provider(cls)
    if record is None or record.component is not None:
        return cls.kind
    if record.owner == OWN and (
        everywhere
        or not context.preference()
        or plugins.offer(cls.role, cls.kind) is record
    ):
        return cls.kind
    return f"{record.owner}:{cls.kind}"


names.spelling = _spelling


def _brought(asks: Callable[[str], bool]) -> str:
    with _discovery:
        if _finding:
            return ""
    what = next((what for name, what in current().brought() if asks(name)), "")
    return what and f"see {what}"


limits.brought = _brought


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
