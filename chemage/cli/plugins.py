"""The commands about plugins: list, show, new, check."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from chemage.cli import completion, output
from chemage.cli.options import ForceOpt, JsonOpt, user_error
from chemage.foundation.errors import nearest
from chemage.plugins import registry
from chemage.plugins.hooks import OFFERED, OFFERS

if TYPE_CHECKING:
    from chemage.plugins.registry import PluginRecord, Registry

plugins_app = typer.Typer(
    no_args_is_help=True, help="List, explain, check and create plugins."
)


@plugins_app.command("list")
def plugins_list(as_json: JsonOpt = False) -> None:
    """List installed components, scenes, hooks and options of plugins.

    Each is listed with its role, the name of its plugin, and the package from which it comes.
    """

    plugins = registry.current()
    rows = []
    for role in plugins.roles:
        for kind in plugins.kinds(role):
            for record in plugins.offers(role, kind):
                own = record.own_kind(role, kind)
                # optional libraries of kinds, with their licences
                needs = getattr(
                    plugins.implementation(record.name), "CHEMAGE_NEEDS", {}
                )
                source = (
                    f"{record.source}; needs {needs[own]}"
                    if own in needs
                    else record.source
                )
                about = {
                    "plugin": record.name,
                    "from": source,
                    "target": record.kinds[role][own],
                }
                rows.append({"role": role, "kind": kind, **about})
    hooks = [
        {"plugin": record.name, "from": record.source, "hooks": names}
        for record in plugins.records
        if (names := _stage_hooks(plugins, record))
    ]
    options = [record.name for record in plugins.records if record.options]
    broken = [
        {"plugin": r.name, "from": r.source, "error": r.error}
        for r in plugins.records
        if r.error
    ]
    if as_json:
        found = {
            "components": rows,
            "scenes": plugins.scenes(),
            "materials": plugins.materials(),
        }
        output.say_json(
            {**found, "hooks": hooks, "options": options, "broken": broken}
        )
        return
    lines = [(row["role"], row["kind"], row["plugin"], row["from"]) for row in rows]
    for record in plugins.records:
        for what, targets in record.offered.items():
            lines += [
                (OFFERED[what], name, record.name, record.source)
                for name in targets
            ]
    for item in hooks:
        lines += [
            ("hook", name, item["plugin"], item["from"]) for name in item["hooks"]
        ]
    lines += [
        ("options", f"[plugins.{name}]", name, plugins.source(name) or "")
        for name in options
    ]
    output.show_rows("", ("role", "kind", "plugin", "from"), lines)
    for item in broken:
        output.say(f"skipped: {item['plugin']} ({item['from']}): {item['error']}")


def _stage_hooks(plugins: Registry, record: PluginRecord) -> list[str]:
    """Names of the hooks that a plugin implements, other than those by which it offers components and scenes."""
    plugin = plugins.manager.get_plugin(f"{record.name} ({record.source})")
    callers = (
        plugins.manager.get_hookcallers(plugin) or () if plugin is not None else ()
    )
    return sorted({caller.name for caller in callers} - {*OFFERS})


@plugins_app.command("show")
def plugins_show(
    kind: Annotated[
        str,
        typer.Argument(
            metavar="NAME",
            autocompletion=completion.kinds,
            help="a kind, such as fft-bem, or the name of a plugin or of its section",
        ),
    ],
    role: Annotated[
        str | None,
        typer.Option(
            metavar="ROLE",
            autocompletion=completion.roles,
            help="role of the component; default: every role that has this kind",
        ),
    ] = None,
    as_json: JsonOpt = False,
) -> None:
    """Explain a component or a plugin.

    Prints what a component computes, its options with units and defaults, and its references; of a plugin, its hooks
    and the options that a scene sets in [plugins.NAME].
    """
    from chemage.scene.schema import options_of

    plugins = registry.current()
    roles = [
        name
        for name in plugins.roles
        if plugins.offers(name, kind) and role in (None, name)
    ]
    plugin = next(
        (
            one
            for one in plugins.records
            if one.name == kind and role is None and not one.error
        ),
        plugins.owners.get(kind) if role is None else None,
    )
    if not roles and plugin is None:
        known = sorted(
            {
                k
                for name in plugins.roles
                if role in (None, name)
                for k in plugins.kinds(name)
            }
        )
        names = sorted(one.name for one in plugins.records if role is None)
        raise user_error(
            f"no kind {kind!r}{nearest(kind, [*known, *names])}; installed: {', '.join(known)}"
            + (f"; plugins: {', '.join(names)}" if names else "")
        )
    shown = [_about_plugin(plugins, plugin)] if plugin is not None else []
    for name in roles:
        cls: Any = plugins.component(name, kind)
        about = {
            "role": name,
            "kind": kind,
            "from": plugins.offer(name, kind).source,
        }
        shown.append(
            {
                **about,
                "about": (cls.__doc__ or "").strip(),
                "options": options_of(cls),
                "cite": [*cls.cite],
            }
        )
    if as_json:
        output.say_json(shown)
        return
    import inspect

    for one in shown:
        output.say(
            f"{one['role']} {one['kind']}  ({one['from']})\n\n{inspect.cleandoc(one['about'])}\n"
        )
        for hook in one.get("hooks", ()):
            output.say(f"hook: {hook}")
        rows = [
            (option["name"], option["unit"], option["default"], option["meaning"])
            for option in one["options"]
        ]
        if rows:
            output.show_rows("", ("option", "unit", "default", "meaning"), rows)
        for text in one["cite"]:
            output.say(f"cite: {text}")


def _about_plugin(plugins: Registry, record: PluginRecord) -> dict[str, Any]:
    """What ``plugins show`` prints of a plugin, in the form of a component."""
    from chemage.scene.schema import options_of

    cls: Any = plugins.options_class(record.name) if record.options else None
    module = plugins.implementation(record.name)
    return {
        "role": "plugin",
        "kind": record.name,
        "from": record.source,
        "about": (getattr(module, "__doc__", None) or "").strip(),
        "section": f"plugins.{record.name}" if cls is not None else None,
        "hooks": _stage_hooks(plugins, record),
        "components": {role: sorted(kinds) for role, kinds in record.kinds.items()},
        "options": options_of(cls) if cls is not None else [],
        "cite": list(cls.cite) if cls is not None else [],
    }


@plugins_app.command("new")
def plugins_new(
    name: Annotated[
        str,
        typer.Argument(
            metavar="NAME", help="kind of the new component, such as my-barriers"
        ),
    ],
    role: Annotated[
        str,
        typer.Option(
            metavar="ROLE",
            autocompletion=completion.roles,
            help="role of the component, such as barriers; `chemage plugins list` lists all roles",
        ),
    ],
    folder: Annotated[
        Path,
        typer.Option(
            "--in",
            metavar="FOLDER",
            help="folder in which to create the folder chemage-NAME",
        ),
    ] = Path(),
) -> None:
    """Create the folder of a new plugin.

    It contains a small working component of the role, its entry point, and tests.
    """
    from chemage.scaffold import new

    files = new(name, role, folder)
    for path in files:
        output.say(path)
    output.remark(
        f"\nnext: {shlex.join(['pip', 'install', '-e', str(files[0].parent)])} && chemage plugins show {name}"
    )


@plugins_app.command("stubs")
def plugins_stubs(
    folder: Annotated[
        Path,
        typer.Option(
            "--in",
            metavar="FOLDER",
            help="folder in which the editor looks for type stubs",
        ),
    ] = Path("typings"),
    force: ForceOpt = False,
) -> None:
    """Write type stubs for editors and type checkers.

    With them, an editor knows the options of every installed component.
    """
    from chemage.foundation.files import write_file
    from chemage.scaffold import stubs

    (folder / "chemage").mkdir(parents=True, exist_ok=True)
    for name, text in stubs().items():
        write_file(folder / "chemage" / name, text, force=force)
        output.say(folder / "chemage" / name)


@plugins_app.command("check")
def plugins_check() -> None:
    """Import all components and report problems.

    Notes say which plugins answer the same stage or read the same files and which of them comes first, and which are
    slow to import. The exit status is 1 if there are problems.
    """
    from chemage.scene.materials import material_problems
    from chemage.surfaces.reading import shared_endings

    plugins = registry.current()
    problems = [*plugins.check(), *material_problems()]
    for problem in problems:
        output.say(problem)
    for note in [*plugins.notes(), *shared_endings()]:
        output.remark(f"note: {note}")
    count = sum(
        len(kinds) for record in plugins.records for kinds in record.kinds.values()
    )
    output.say(
        f"{len(plugins.records)} plugins, {count} components, {len(problems)} problems"
    )
    if problems:
        raise typer.Exit(1)
