"""The command ``chemage live``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from chemage.plugin import options, output, preflight, write_file


def live(
    scene: options.SceneArg,
    beside: Annotated[
        str | None,
        typer.Option(metavar="SCENE", help="another scene on the same sliders"),
    ] = None,
    slide: Annotated[
        list[str] | None,
        typer.Option(
            metavar="PATH[=LOW,HIGH]",
            help='an option to move, such as "contact.load=5 nN, 500 nN"; may be repeated; default: load, temperature, '
            "radius and rms slope",
        ),
    ] = None,
    changes: options.SetOpt = None,
    equal_pressure: Annotated[
        bool,
        typer.Option(
            "--equal-pressure",
            help="press the other scene to the same mean contact pressure instead of with the same load",
        ),
    ] = False,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            metavar="FILE",
            help="write one HTML file with results on a grid, which needs no server",
        ),
    ] = None,
    full: Annotated[
        bool,
        typer.Option(
            "--full",
            help="in the file, with all pixels and replicas; default: with less, as while a slider moves",
        ),
    ] = False,
    port: Annotated[
        int, typer.Option(min=0, max=65535, help="of the page; 0: any that is free")
    ] = 0,
    browser: Annotated[
        bool, typer.Option(help="open the page in the browser")
    ] = True,
    force: options.ForceOpt = False,
) -> None:
    """Play with a scene in the browser: its options on sliders.

    The page is served to this machine alone, at a secret address.
    """
    from chemage_live.page import Page

    if out is not None:
        options.check_ending(out, (".html",), "a page")
        preflight(out, force=force)
    page = Page(
        scene,
        beside,
        slide=slide or (),
        changes=options.changed_fields(changes),
        equal_pressure=equal_pressure,
        in_file=out is not None,
    )
    if out is not None:
        write_file(out, page.html(full), force=force)
        output.say(f"page     {out}")
        return
    page.serve(port)
    output.say(f"{page.url}\nCtrl-C ends it.")
    if browser:
        typer.launch(page.url)
    page.thread.join()
