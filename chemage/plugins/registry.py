"""The registry: finds plugins, loads a component on first use, and explains what is wrong.

Nothing heavy happens here: an entry point's module is imported (light by contract), its ``chemage_register`` strings
are kept, and the class behind a kind is imported when it is first used. A broken plugin is recorded and skipped;
with ``CHEMAGE_STRICT=1`` it raises. ``CHEMAGE_PLUGINS=-name`` leaves a plugin out, ``CHEMAGE_PLUGINS=name,other`` uses
just these besides chemage's own. ``CHEMAGE_TRACE=1`` prints every hook call to stderr.

Several plugins that implement the hook of a stage are asked in this order, and as wrappers the first has the last
word: those that the scene, a block or ``CHEMAGE_PREFER`` prefers; registered by hand, the latest first; installed, by
name; chemage itself.
"""

from __future__ import annotations

import importlib
import os
import threading
import time
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from importlib import metadata
from pkgutil import resolve_name
from typing import TYPE_CHECKING, Any, TypeVar

from chemage.foundation import names, ownership
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
    wraps_others,
)

if TYPE_CHECKING:
    from chemage.foundation.outputs import Block

__all__ = ["PluginRecord", "PluginWarning", "Registry", "scene_text", "source_version"]

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
        self.manager = Hooks()
        #: the same hooks in another order, by the names of the plugins that come first
        self._preferring: dict[tuple[str, ...], Hooks] = {}
        self.records: list[PluginRecord] = []
        self.roles: dict[str, str] = {}  # role -> "module:Class" of its abstract class
        self.rooms: list[Any] = []  # modules that declare roles, stages and hooks
        self.owners: dict[
            str, PluginRecord
        ] = {}  # section -> the plugin whose stage it is
        self._stages: list[Stage] | None = None
        self._classes: dict[tuple[str, str], type] = {}
        self._monitor(self.manager)
        for name in ROOMS:
            self.add_room(importlib.import_module(name))
        points = selected(installed(GROUP)) if entry_points is None else entry_points
        # by name: the order never depends on the file system; pluggy asks those first that were registered last
        for point in sorted(points, key=lambda p: (is_own(p), p.name), reverse=True):
            self._load(point)
        self.records.sort(
            key=lambda record: (
                record.distribution != "chemage",
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
        self._attach_room(self.manager, room)
        self.roles |= getattr(room, "ROLES", {})
        self._stages = None
        self._preferring.clear()

    def _attach_room(self, manager: Hooks, room: Any) -> None:
        add_specifications(manager, room)
        if (answers := getattr(room, "ANSWERS", None)) is not None:
            plugin = answers()
            manager.register(plugin, room.__name__.removesuffix(".hooks"))
            self._record(manager, plugin, None, str)

    def _monitor(self, manager: Hooks) -> None:
        if os.environ.get("CHEMAGE_TRACE", "") not in ("", "0"):
            manager.add_hookcall_monitoring(trace_before, trace_after)

    def stages(self) -> list[Stage]:
        """What the rooms declare of their stages, each after those that it rests on."""
        if self._stages is None:
            self._stages = in_order(
                stage for room in self.rooms for stage in getattr(room, "STAGES", ())
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
        self._classes.pop((role, kind), None)
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
        self._classes[role, kind] = checked_class(cls, self.role(role), kind, record)
        self.records.append(record)
        return record

    def unregister_class(self, cls: Any) -> None:
        """The inverse of :meth:`register_class`."""
        self.records = [
            record for record in self.records if record.component is not cls
        ]
        self._classes.pop((getattr(cls, "role", ""), getattr(cls, "kind", "")), None)

    def _register(self, plugin: Any, record: PluginRecord) -> None:
        api = getattr(plugin, "CHEMAGE_API", hooks.API_VERSION)
        if api not in hooks.SUPPORTED_API_VERSIONS:
            raise PluginError(
                f"made for plugin interface {api}, this chemage has {hooks.API_VERSION}"
            )
        record.libraries = versions(getattr(plugin, "CHEMAGE_LIBRARIES", ()))
        record.options = checked_options(getattr(plugin, "CHEMAGE_OPTIONS", ""), record)
        name = full_name(record)
        if self.manager.has_plugin(name) or self.manager.is_registered(plugin):
            raise PluginError(f"{record.module} is registered twice")
        stages, roles = checked_stages(plugin, self.stages(), self.roles)
        if not stages:
            check_hook_names(plugin, self._hook_names())
        self._preferring.clear()
        try:
            self._attach(self.manager, plugin, record)
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
        if stages or roles:
            self.add_room(plugin)
            self.owners |= {stage.section: record for stage in stages}

    def _attach(self, manager: Hooks, plugin: Any, record: PluginRecord) -> None:
        """Add the hooks of a plugin to ``manager``, so that their part in an answer is noted."""
        manager.register(plugin, full_name(record))
        self._record(manager, plugin, record, partial(self.source_in_use, record))

    def _record(
        self,
        manager: Hooks,
        plugin: Any,
        record: PluginRecord | None,
        source: Callable[[], str],
    ) -> None:
        for hook in manager.get_hookcallers(plugin) or ():
            if hook.name not in hooks.OFFERS:
                for impl in hook.get_hookimpls():
                    if impl.plugin is plugin:
                        record_participation(impl, hook, record, source)

    def _hook_names(self) -> list[str]:
        return [name for name in dir(self.manager.hook) if name.startswith("chemage_")]

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

        stage = next((stage for stage in self.stages() if hook in stage.hooks), None)

        def check(answer: Any, who: str) -> None:
            component = None if who else self._own(stage, arguments)
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
            result = getattr(self._in_order(context.preference()).hook, hook)(
                **arguments
            )
        return result, took_part, recorded

    def _own(self, stage: Stage | None, arguments: Mapping[str, Any]) -> Any:
        """The component whose method chemage calls where no plugin answers."""
        role = (stage is not None and stage.role) or None
        return next(
            (part for part in arguments.values() if getattr(part, "role", "") == role),
            None,
        )

    def _named(self, component: Any) -> str:
        """A component with the plugin that provides it."""
        if component is None:
            return "chemage"
        cls = type(component)
        return f"{component.role} {component.kind!r} of {self.owner(cls) or 'chemage'}"

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
        return f"{code.__module__}.{code.__qualname__} {source_version(code)}".strip()

    def check_preference(self, names: Iterable[str], where: str) -> None:
        """Raise an InputError if one of these plugins, named in ``where``, is not in use."""
        in_use = [record.name for record in self.records if not record.error]
        if unknown := [name for name in names if name not in in_use]:
            hint = nearest(unknown[0], in_use) if len(unknown) == 1 else ""
            raise InputError(
                f"{where} names {', '.join(map(repr, unknown))}, which is not installed{hint}; "
                f"the plugins are {', '.join(sorted(in_use))}"
            )

    def _in_order(self, prefer: tuple[str, ...]) -> Hooks:
        """The hooks, with the plugins ``prefer`` first."""
        if not prefer:
            return self.manager
        if prefer not in self._preferring:
            self.check_preference(prefer, f"the preference {', '.join(prefer)}")
            records = {full_name(record): record for record in self.records}
            first = {
                name: record
                for name, record in records.items()
                if record.name in prefer
            }
            manager = Hooks([self.manager.get_plugin(name) for name in first])
            self._monitor(manager)
            for room in self.rooms:
                self._attach_room(manager, room)
            rest = [
                name
                for name, _ in self.manager.list_name_plugin()
                if name in records and name not in first
            ]
            preferred = sorted(
                first, key=lambda name: prefer.index(first[name].name), reverse=True
            )
            for name in [*rest, *preferred]:
                plugin = self.manager.get_plugin(name)
                if plugin is not None:  # a class that was registered has no hooks
                    self._attach(manager, plugin, records[name])
            self._preferring[prefer] = manager
        return self._preferring[prefer]

    def implementing(self, *hook_names: str) -> Plugins:
        """The plugins, other than chemage's own rooms, that implement any of these hooks: name -> source, sorted."""
        records = {
            record.name: record
            for hook in hook_names
            for record, _ in self.functions(hook)
        }
        return {
            name: self.source_in_use(record) for name, record in sorted(records.items())
        }

    def functions(self, hook: str) -> list[tuple[PluginRecord, Any]]:
        """Each plugin that implements ``hook``, with its function, sorted by the name of the plugin."""
        implementations = {
            each.plugin_name: each.function
            for each in getattr(self.manager.hook, hook).get_hookimpls()
        }
        records = sorted(self.records, key=lambda record: record.name)
        return [
            (record, implementations[name])
            for record in records
            if (name := full_name(record)) in implementations
        ]

    def implementation(self, name: str) -> Any:
        """The module or object with the hooks of the plugin ``name``."""
        return self.manager.get_plugin(
            next(full_name(record) for record in self.records if record.name == name)
        )

    def state(self) -> str:
        """A hash of all plugins with their versions."""
        return short_hash(
            "\n".join(
                sorted(
                    f"{each.name} {each.source} {each.error}" for each in self.records
                )
            ),
            8,
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
                context.options().get(record.name) or self.options_class(record.name)()
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
        if record is None or record.error or not record.options:
            with_options = [each.name for each in self.records if each.options]
            hint = f"; plugins with options: {', '.join(with_options) or 'none'}"
            if record is None:
                raise InputError(
                    f"no plugin {name!r}{nearest(name, with_options)} is installed{hint}"
                )
            problem = (
                f"was skipped: {record.error}"
                if record.error
                else f"has no options{hint}"
            )
            raise InputError(f"plugin {name!r} {problem}")
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
            option for option, info in cls.model_fields.items() if info.is_required()
        ]:
            raise PluginError(
                f"{where}: {', '.join(required)} must have a default, for scenes that do not set it"
            )
        return cls

    def provider(self, cls: type) -> PluginRecord | None:
        """The plugin whose component ``cls`` is; None for a class that is not registered."""
        role, kind = getattr(cls, "role", ""), getattr(cls, "kind", "")
        is_imported = (
            self._classes.get((role, kind)) is cls
        )  # perhaps under another path than its own
        for record in self.records:
            offered = record.kinds.get(role, {}).get(kind)
            own = (
                record.component is cls
                or offered == f"{cls.__module__}:{cls.__qualname__}"
            )
            if offered is not None and (own or is_imported):
                return record
        return None

    def stage_hooks(self) -> list[str]:
        """The hooks of which one answer is used: those of the stages."""
        return [
            name
            for name in self._hook_names()
            if is_stage(getattr(self.manager.hook, name))
        ]

    # -- components ---------------------------------------------------------------------------------------------------

    def kinds(self, role: str) -> list[str]:
        """Kinds installed for ``role``, sorted."""
        return sorted(
            {kind for record in self.records for kind in record.kinds.get(role, ())}
        )

    def offers(self, role: str, kind: str) -> list[PluginRecord]:
        """The plugins that claim ``kind``."""
        return [record for record in self.records if kind in record.kinds.get(role, ())]

    def clashes(self) -> list[str]:
        """A sentence for each kind, scene and name of a plugin that is claimed more than once."""
        claims = [
            (role, kind, self.offers(role, kind))
            for role in self.roles
            for kind in self.kinds(role)
        ]
        for what, one in hooks.OFFERED.items():
            claims += [
                (one, name, self._offering(what, name)) for name in self.offered(what)
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
            installed = self.kinds(role)
            broken = [record.name for record in self.records if record.error]
            raise UnknownKindError(
                f"no {role} {kind!r}{nearest(kind, installed)}; installed: {', '.join(installed) or 'none'}"
                + (f" (skipped because broken: {', '.join(broken)})" if broken else "")
            )
        if len(offers) > 1:
            raise PluginError(clash(role, kind, offers))
        self._classes[role, kind] = cls = self._import(role, kind, offers[0])
        return cls

    def role(self, name: str) -> Any:
        """The abstract class of a role; InputError if there is none."""
        if name not in self.roles:
            raise InputError(
                f"no such role {name!r}; the roles are {', '.join(self.roles)}"
            )
        return imported(self.roles[name])

    def make(self, role: str, kind: str, options: Mapping[str, Any]) -> Any:
        """The component ``kind`` with ``options``."""
        return self.component(role, kind)(**options)

    def fromdict(self, role: str, fields: Mapping[str, Any]) -> Any:
        """A component from its ``todict()``."""
        if not isinstance(fields, Mapping) or not all(
            isinstance(name, str) for name in fields
        ):
            raise InputError.of("fields", fields, "is not a table of options by name")
        options = dict(fields)
        if "kind" not in options:
            raise InputError(
                f"{role}: kind is required; installed: {', '.join(self.kinds(role)) or 'none'}"
            )
        return self.make(role, options.pop("kind"), options)

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
            record for record in self.records if name in record.offered.get(what, {})
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
        for name in self.stage_hooks():
            implementations = getattr(
                self._in_order(context.preference()).hook, name
            ).get_hookimpls()
            for wraps, verb, wins in (
                (False, "answer", "is asked first"),
                (True, "wrap", "has the last word"),
            ):
                order = [
                    each.plugin_name
                    for each in reversed(implementations)
                    if wraps_others(each) == wraps
                ]
                sharing = [
                    record
                    for full in order
                    for record in self.records
                    if full_name(record) == full
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


def named(name: str) -> Any:
    """What a plugin brings to ``chemage`` under this name; AttributeError if none does."""
    with _discovery:
        known = {} if _finding or name.startswith("_") else current().offered("names")
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
