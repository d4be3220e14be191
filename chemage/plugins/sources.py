"""Which plugins, in which versions, a result comes from, and whether those in use now would make the same.

A plugin takes part in a result if it answered the hook of a stage or changed its answer, if it provides one of the
components (at any depth), or if it provides the reader of a file. chemage itself, whose version is in every result, is
not listed.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from operator import methodcaller
from typing import Any, TypeVar

import pluggy

from chemage.foundation.aliases import Data
from chemage.foundation.components import Component
from chemage.foundation.errors import ChemageError, PluginError
from chemage.foundation.outputs import Block, kept, recording
from chemage.foundation.records import (
    Record,
    approximation_made_by,
    merged_approximations,
)
from chemage.plugins.content import changed_fields, contents, differences
from chemage.plugins.context import Plugins, TakingPart, taking_part
from chemage.plugins.hooks import Stage, StageInputs, hookimpl
from chemage.plugins.loading import OWN, add_specifications, full_name
from chemage.plugins.registry import Registry, current, source_version

R = TypeVar("R", bound=Record)


def nested(value: Any, path: str = "") -> list[tuple[str, Any]]:
    """The components in a component, a list or a mapping, at any depth, a component before its parts: (path,
    component)."""
    found: list[tuple[str, Any]] = []
    ahead = [(path, value)]
    while ahead:
        path, value = ahead.pop()
        if isinstance(value, Component):
            found.append((path, value))
            names = type(value).model_fields
            value = dict(zip(names, map(vars(value).get, names), strict=True))
        elif isinstance(value, list | tuple):
            value = dict(enumerate(value))
        if isinstance(value, Mapping):
            for name in reversed([*value]):
                if not isinstance(value[name], int | float | str):
                    ahead.append((f"{path}.{name}", value[name]))
    return found


def components_in(*values: Any) -> list[Any]:
    """The components with a role in components, lists and mappings, as :func:`nested` finds them."""
    return [each for _, each in nested(values) if each.role]


def providers(*components: Any) -> Plugins:
    """The plugins other than chemage that provide the components and their parts: name -> source."""
    return _providers(components_in(*components))


def _providers(parts: Iterable[Any]) -> Plugins:
    plugins = current()
    sources: Plugins = {}
    for part in parts:
        cls = type(part)
        record = plugins.provider(cls)
        if record is None:
            sources[f"{cls.__module__}.{cls.__qualname__}"] = source_version(cls)
        elif record.owner != OWN:
            sources[record.name] = plugins.source_in_use(record)
    return sources


def approximations(*components: Any) -> list[Data]:
    """What is approximate about the components and their parts, as :mod:`chemage.foundation.records` has it."""
    return merged_approximations(
        *map(approximation_made_by, components_in(*components))
    )


def noted(record: R, block: Block, took_part: TakingPart, *components: Any) -> R:
    """``record`` with what was recorded beside it, and with who ``took_part`` in it, and the plugins that provide its
    ``components``; and what is approximate about these."""
    parts = components_in(*components)
    approximate = [entry for part in parts for entry in approximation_made_by(part)]
    plugins = _providers(parts) | took_part.plugins
    return record.noting(
        plugins, approximate, kept(record, block), took_part.changes
    )


def approximation_of(role: str, kind: str) -> list[Data]:
    """The same of an installed kind, such as the engine that a plugin used; empty where it is not known."""
    try:
        return approximation_made_by(current().component(role, kind))
    except ChemageError:
        return []


def run_stage(stage: Stage, inputs: StageInputs) -> Any:
    """What a stage makes; where a plugin declares it, with its options, its plugin and what it recorded noted in it.

    Raises
    ------
    PluginError
        It makes something else than it changes, or what contradicts itself; or a plugin changed in place what stages
        before it made.
    """
    plugins = current()
    record = plugins.owners.get(stage.section)
    hooks = implementing(*stage_hooks())
    who = (
        f"the stage {stage.section!r} of {full_name(record)}"
        if record
        else f"a hook of {', '.join(hooks)}"
    )
    given = contents(inputs.made) if record or hooks else {}
    with recording() as block, taking_part() as took_part:
        made = stage.run(inputs)
    if given and (paths := differences(given, contents(inputs.made, given))):
        raise PluginError(
            f"{who} changed {paths[0]}, which is made already, in place; make a changed copy"
        )
    if record is None:
        return made
    options, before = inputs.parts[stage.section], inputs.made[stage.makes]
    if type(made) is not type(before):
        raise PluginError(
            f"{who} made {type(made).__name__}; expected {type(before).__name__}"
        )
    maker = next(
        each
        for each in plugins.stages()
        if each.makes == stage.makes and not each.changes
    )
    if fault := maker.fault_of(made, inputs):
        raise PluginError(f"{who}: {fault}")
    fields = changed_fields(contents(before), contents(made, {}))
    took_part.plugins[record.name] = plugins.source_in_use(record)
    took_part.changes[record.name] = {f"{stage.section}.{one}" for one in fields}
    made = noted(made, block, took_part, options)
    said = stage.todict({stage.section: options}, methodcaller("todict"))
    return made.model_copy(update={"provenance": {**made.provenance, **said}})


def changed(
    recorded: Plugins, *, options: bool = True
) -> dict[str, tuple[str, str]]:
    """Of the plugins recorded with a result, those that are not in use in that version: name -> (then, now).

    A plugin with other options counts as well, unless ``options`` is False.
    """
    plugins, shown = (
        current(),
        (lambda source: source) if options else without_options,
    )
    now = {name: plugins.source(name) or "not installed" for name in recorded}
    return {
        name: (source, now[name])
        for name, source in recorded.items()
        if shown(now[name]) != shown(source)
    }


def without_options(source: str) -> str:
    """The source of a plugin without the options that were in use."""
    return source.partition(" [")[0]


def implementing(*hook_names: str) -> Plugins:
    """The plugins that implement any of these hooks: name -> source."""
    return current().implementing(*hook_names)


def stage_hooks() -> list[str]:
    """The hooks whose answers are part of a result."""
    return [*current().stage_hooks(), "chemage_observe"]


def would_change(
    names: Iterable[str], hook: str, answer: Any, **arguments: Any
) -> bool:
    """Whether any of the plugins ``names`` would answer this call of a stage's hook, or change ``answer``.

    A plugin that fails counts as one that would.
    """
    plugins: Registry = current()
    manager = pluggy.PluginManager("chemage")
    for room in plugins.rooms:
        add_specifications(manager, room)
    answering = type(
        "Given", (), {hook: hookimpl(trylast=True)(lambda self: answer)}
    )
    manager.register(answering(), "given")
    for name in names:
        manager.register(plugins.implementation(name), name)
    try:
        before = contents(answer)
        other = getattr(manager.hook, hook)(**arguments)
        return other is not answer or contents(other) != before
    except Exception:
        return True
