"""The commands about plugins: list, show, new, check."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from chemage.cli import terminal
from chemage.cli.options import ForceOpt, JsonOpt, user_error

if TYPE_CHECKING:
    from chemage.plugins.registry import PluginRecord, Registry

plugins_app = typer.Typer(no_args_is_help=True, help="List, explain, check and create plugins.")


@plugins_app.command("list")
def plugins_list(as_json: JsonOpt = False) -> None:
    """List installed components, scenes and hooks.

    Each is listed with its role and the package from which it comes.
    """
    from chemage.plugins import registry

    plugins = registry.current()
    rows = [
        {"role": role, "kind": kind, "from": record.source, "target": record.kinds[role][kind]}
        for role in plugins.roles
        for kind in plugins.kinds(role)
        for record in plugins.offers(role, kind)
    ]
    hooks = [
        {"plugin": record.name, "from": record.source, "hooks": names}
        for record in plugins.records
        if (names := _stage_hooks(plugins, record))
    ]
    broken = [{"plugin": r.name, "from": r.source, "error": r.error} for r in plugins.records if r.error]
    if as_json:
        print(json.dumps({"components": rows, "scenes": plugins.scenes(), "hooks": hooks, "broken": broken}))
        return
    table = terminal.table("", ("role", "kind", "from"))
    for row in rows:
        table.add_row(row["role"], row["kind"], row["from"])
    for record in plugins.records:
        for name in record.scenes:
            table.add_row("scene", name, record.source)
    for item in hooks:
        for name in item["hooks"]:
            table.add_row("hook", name, item["from"])
    terminal.show(table)
    for item in broken:
        terminal.say(f"skipped: {item['plugin']} ({item['from']}): {item['error']}")


def _stage_hooks(plugins: Registry, record: PluginRecord) -> list[str]:
    """Names of the hooks that a plugin implements, other than those by which it offers components and scenes."""
    plugin = plugins.manager.get_plugin(f"{record.name} ({record.source})")
    callers = plugins.manager.get_hookcallers(plugin) or () if plugin is not None else ()
    return sorted({caller.name for caller in callers} - {"chemage_register", "chemage_scenes"})


@plugins_app.command("show")
def plugins_show(
    kind: Annotated[str, typer.Argument(help="a kind, such as fft-bem")],
    role: Annotated[
        str | None, typer.Option(help="role of the component; default: every role that has this kind")
    ] = None,
    as_json: JsonOpt = False,
) -> None:
    """Explain a component.

    Prints what it computes, its options with units and defaults, and its references.
    """
    from chemage.experiments.schema import options_of
    from chemage.foundation.messages import nearest
    from chemage.plugins import registry

    plugins = registry.current()
    roles = [name for name in plugins.roles if kind in plugins.kinds(name) and role in (None, name)]
    if not roles:
        known = sorted({k for name in plugins.roles if role in (None, name) for k in plugins.kinds(name)})
        raise user_error(f"no kind {kind!r}{nearest(kind, known)}; installed: {', '.join(known)}")
    shown = []
    for name in roles:
        cls: Any = plugins.component(name, kind)
        source = plugins.offers(name, kind)[0].source
        shown.append(
            {
                "role": name,
                "kind": kind,
                "from": source,
                "about": (cls.__doc__ or "").strip(),
                "options": options_of(cls),
                "cite": list(cls.cite),
            }
        )
    if as_json:
        print(json.dumps(shown))
        return
    import inspect

    for one in shown:
        terminal.say(f"{one['role']} {one['kind']}  ({one['from']})\n\n{inspect.cleandoc(one['about'])}\n")
        table = terminal.table("", ("option", "unit", "default", "meaning"))
        for option in one["options"]:
            table.add_row(option["name"], option["unit"], option["default"], option["meaning"])
        if one["options"]:
            terminal.show(table)
        for text in one["cite"]:
            terminal.say(f"cite: {text}")


@plugins_app.command("new")
def plugins_new(
    name: Annotated[str, typer.Argument(help="kind of the new component, such as my-barriers")],
    role: Annotated[
        str, typer.Option(help="role of the component, such as barriers; `chemage plugins list` shows all roles")
    ],
    folder: Annotated[Path, typer.Option("--in", help="folder in which to create chemage-NAME")] = Path(),
) -> None:
    """Create the folder of a new plugin.

    It contains a small working component of the role, its entry point, and tests.
    """
    from chemage.scaffold.new import new

    files = new(name, role, folder)
    for path in files:
        terminal.say(path)
    terminal.say(f"\nnext: pip install -e {files[0].parent} && chemage plugins show {name}")


@plugins_app.command("stubs")
def plugins_stubs(
    folder: Annotated[Path, typer.Option("--in", help="folder of type stubs, as editors know it")] = Path("typings"),
    force: ForceOpt = False,
) -> None:
    """Write type stubs, so that editors and type checkers know the options of every installed component."""
    from chemage.foundation.files import fresh_file
    from chemage.scaffold.stubs import stub_text

    target = folder / "chemage" / "__init__.pyi"
    target.parent.mkdir(parents=True, exist_ok=True)
    with fresh_file(target, force=force) as part:
        part.write_text(stub_text(), encoding="utf-8")
    terminal.say(target)


@plugins_app.command("check")
def plugins_check() -> None:
    """Import all components, report problems.

    The exit status is 1 if there are problems.
    """
    from chemage.plugins import registry

    plugins = registry.current()
    problems = plugins.check()
    for problem in problems:
        terminal.say(problem)
    count = sum(len(kinds) for record in plugins.records for kinds in record.kinds.values())
    terminal.say(f"{len(plugins.records)} plugins, {count} components, {len(problems)} problems")
    if problems:
        raise typer.Exit(1)
