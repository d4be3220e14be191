"""The command about materials."""

from __future__ import annotations

import json
from typing import Annotated

import typer

from chemage.cli import terminal
from chemage.cli.options import JsonOpt, user_error


def materials(
    name: Annotated[str | None, typer.Argument(help="a material, such as silica; default: list all")] = None,
    as_toml: Annotated[
        bool, typer.Option("--toml", help="print the sections of a scene, with the sources as comments, to copy")
    ] = False,
    as_json: JsonOpt = False,
) -> None:
    """List materials, or show the values of one.

    Each value is shown with its source and how it is known: measured, calculated, calibrated or estimated. A scene
    names a material with material = "NAME", which fills what the scene does not say.
    """
    from chemage.plugins import registry
    from chemage.scene.materials import material

    if as_toml and (name is None or as_json):
        raise user_error("--toml: give the name of a material, and no --json")
    if name is None:
        known = [material(one) for one in sorted(registry.current().materials())]
        if as_json:
            print(json.dumps([one.todict() for one in known]))
            return
        table = terminal.table("", ("material", "", "values", "from"))
        for one in known:
            table.add_row(one.name, one.title, str(len(one.values)), one.source)
        terminal.show(table)
        return
    one = material(name)
    if as_json:
        print(json.dumps(one.todict()))
    elif as_toml:
        terminal.say(one.toml(), end="")
    else:
        table = terminal.table(f"{one.name}: {one.title}", ("value", "", "how", "source"))
        for value in one.values:
            table.add_row(value.path, value.text, value.how, value.source + (f"; {value.note}" if value.note else ""))
        if one.about:
            terminal.say(f"{one.about}\n")
        terminal.show(table)
