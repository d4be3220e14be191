"""The command ``chemage roughness``."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from chemage import Surface
    from chemage_surfaces.images import Image, Measured
    from chemage_surfaces.roughness_fit import RoughnessFit


#: distance of sites on silica, nm
SITES = 0.45
#: text that may be left out
Text = str | None


def _how(metavar: str, what: str) -> Any:
    return typer.Option(metavar=metavar, help=what)


def roughness(
    paths: Annotated[
        list[Path],
        typer.Argument(
            metavar="FILE...", help="images of one surface, at any magnifications"
        ),
    ],
    reader: Annotated[
        Text,
        _how("KIND", "kind of the reader; default: by the content of the file"),
    ] = None,
    channel: Annotated[
        Text,
        _how("NAME", "channel of the file; default: the first one with heights"),
    ] = None,
    transpose: Annotated[
        bool,
        typer.Option(
            "--transpose",
            help="exchange lines and columns of a table; by default each line is a scan line, along x",
        ),
    ] = False,
    height_unit: Annotated[
        Text,
        _how(
            "UNIT", "unit of the heights, such as nm; default: as the file states"
        ),
    ] = None,
    pixel_size: Annotated[
        Text,
        _how(
            "LENGTH",
            "edge of a pixel, nm or with a unit; default: as the file states",
        ),
    ] = None,
    lines: Annotated[
        str,
        _how(
            "HOW",
            "align scan lines: none, differences, constant, linear or quadratic",
        ),
    ] = "none",
    scars: Annotated[
        str, _how("ACTION", "what to do with scars: keep or interpolate")
    ] = "keep",
    detrend: Annotated[
        Text,
        _how(
            "TREND",
            "trend to subtract: none, mean, plane or quadratic; default: plane, or mean if periodic",
        ),
    ] = None,
    missing: Annotated[
        str,
        _how(
            "ACTION", "what to do with missing heights: few, refuse or interpolate"
        ),
    ] = "few",
    spikes: Annotated[
        str,
        _how("ACTION", "what to do with spikes: few, refuse, keep or interpolate"),
    ] = "few",
    resample: Annotated[
        Text, _how("LENGTH", "edge of square pixels to make; default: as they are")
    ] = None,
    periodic: Annotated[
        bool | None,
        typer.Option(
            help="whether the image is one period of the surface; default: as the file states"
        ),
    ] = None,
    resolution: Annotated[
        Text,
        _how(
            "LENGTH",
            "shortest wavelength of the fit; default: as far as the image is trusted",
        ),
    ] = None,
    tip_radius: Annotated[
        Text,
        _how(
            "LENGTH",
            "radius of the tip; default: as valleys sharper than peaks show it",
        ),
    ] = None,
    retrace: Annotated[
        bool,
        typer.Option(
            help="take the difference between trace and retrace, where the file has both, as noise"
        ),
    ] = True,
    spacing: Annotated[
        Text,
        _how(
            "LENGTH",
            "pixel size in the printed section; default: that of the image",
        ),
    ] = None,
    cutoff: Annotated[
        Text,
        _how(
            "LENGTH",
            "shortest wavelength in the printed section; default: that of the fit",
        ),
    ] = None,
    figures: Annotated[
        Path | None,
        _how(
            "FOLDER",
            "also draw roughness.png (spectrum and differences) and findings.png (the images and what was found in them)",
        ),
    ] = None,
    width: Annotated[
        Text,
        _how(
            "WIDTH",
            "for print: 1 or 2 columns of a page (85 or 180 mm), or a length such as 120mm; default: for a screen",
        ),
    ] = None,
    force: Annotated[
        bool, typer.Option("--force", help="overwrite the figure")
    ] = False,
) -> None:
    """Examine an image, measure its roughness, and fit it.

    Prints what was found in any image (artefacts of the instrument, periodic waves, terraces), whether it was mended,
    is only noted or is refused, and which option helps; rms height, slope and curvature along both axes and by
    distance; then, of images that make a surface, Hurst exponent and roll-off with their errors, fitted to all of them
    together, and the section [surface] of a scene that makes random surfaces like them. Where there is no fit or no
    section, it says why.
    """
    detrend = detrend or ("mean" if periodic else "plane")
    pixel_size, resample, resolution, tip_radius, spacing, cutoff = (
        f"{length} nm" if length and length[-1].isdigit() else length
        for length in (
            pixel_size,
            resample,
            resolution,
            tip_radius,
            spacing,
            cutoff,
        )
    )
    given = locals()
    if transpose:
        given["reader"] = {"kind": reader or "text", "transpose": True}
    from chemage_surfaces.measures import Measures

    makers, images = _examined(paths, given, channel)
    measures = [Measures.of(image.heights, image.sides) for image in images]
    for maker, image, found in zip(makers, images, measures, strict=True):
        if len(paths) > 1:
            typer.echo(f"{image.source}:")
        _print_channel(maker, image)
        _print_steps(image)
        typer.echo(f"{found.text()}\n")
    fault = next((image.faults[0] for image in images if image.faults), "")
    retraces = [
        maker.retrace() if retrace and resolution is None and not fault else None
        for maker in makers
    ]
    fit, why = (
        (None, fault)
        if fault
        else _fitted(images, resolution, tip_radius, retraces)
    )
    if figures is not None:
        from chemage_surfaces.roughness_figure import save_figures

        names = [path.name for path in paths]
        save_figures(names, images, measures, fit, figures, width, force)
    if fit is None:
        typer.echo(f"no fit: {why}")
        return
    _print_fit(images, retraces, fit)
    if not fit.fault:
        typer.echo(fit.section(spacing, cutoff))
    elif len(makers) > 1:
        typer.echo(f"no section [surface]: {fit.fault}")
    else:
        typer.echo(
            f"no self-affine surface: {fit.fault}\nthis is the image itself, carried on:\n"
        )
        typer.echo(_carried_on(makers[0], fit, spacing, cutoff, tip_radius))


def _examined(
    paths: list[Path], given: Mapping[str, Any], channel: str | None
) -> tuple[list[Measured], list[Image]]:
    """The images, with what was found in them; options of the surface have the names of those of the command."""
    from chemage_surfaces.findings import STRUCTURES, Scan, examine
    from chemage_surfaces.images import Measured

    options = {
        name: given[name]
        for name in Measured.model_fields
        if given.get(name) is not None
    }
    makers = [
        Measured(path=str(path), **options).of_channel(channel) for path in paths
    ]
    images = [maker.image() for maker in makers]
    for image in images:
        if not image.faults:
            scan = Scan(image.heights, image.sides, image.periodic)
            image.findings += examine(scan, STRUCTURES)
    return makers, images


def _fitted(
    images: list[Image],
    resolution: str | None,
    tip_radius: str | None,
    retraces: list[Surface | None],
) -> tuple[RoughnessFit | None, str]:
    """The fit to all images, or why there is none."""
    from chemage import InputError
    from chemage_surfaces.images import Measured
    from chemage_surfaces.roughness_fit import fit_roughness

    surfaces = [
        image.surface(kind=Measured.kind, **image.unfit()) for image in images
    ]
    try:
        return fit_roughness(
            surfaces,
            resolution=resolution,
            tip_radius=tip_radius,
            retraces=retraces,
        ), ""
    except InputError as error:
        if resolution is not None or tip_radius is not None:
            raise
        return None, str(error)


def _carried_on(
    maker: Measured,
    fit: RoughnessFit,
    spacing: str | None,
    cutoff: str | None,
    tip_radius: str | None,
) -> str:
    """The section ``[surface]`` of a scene, TOML, of the image carried on to finer pixels."""
    side = fit.pixel_size / max(2, round(fit.pixel_size / SITES))
    options = {
        "kind": "roughened",
        "pixel_size": spacing or f"{side:.10g} nm",
        "cutoff": cutoff,
        "tip_radius": tip_radius,
        "seed": 1,
    }
    given = {name: getattr(maker, name) for name in maker.model_fields_set}
    if "pixel_size" in given:
        given["pixel_size"] = list(given["pixel_size"])
    image = {"kind": maker.kind, **given}
    if maker.reader is not None:
        image["reader"] = maker.reader.todict()
    return "\n".join(
        ["[surface]", *_toml(options), "", "[surface.surface]", *_toml(image)]
    )


def _toml(options: Mapping[str, Any]) -> list[str]:
    """Options as lines of TOML."""
    lines = []
    for name, value in options.items():
        if isinstance(value, Mapping):
            lines.append(f"{name} = {{ {', '.join(_toml(value))} }}")
        elif value is not None:
            lines.append(f"{name} = {json.dumps(value)}")
    return lines


def _print_steps(image: Image) -> None:
    """Print the steps that changed heights, and what was found."""
    lines = image.steps[0].get("lines")
    if lines is not None:
        typer.echo(
            f"lines of the table  {lines}; --transpose reads them the other way"
        )
    for step in image.steps:
        if step["step"] in ("lines", "scars", "spikes", "missing"):
            typer.echo(
                f"{step['step']:<19} "
                + ", ".join(f"{k} {v}" for k, v in step.items() if k != "step")
            )
    for found in image.findings:
        typer.echo(found.line())


def _print_fit(
    images: list[Image], retraces: list[Surface | None], fit: RoughnessFit
) -> None:
    """Print the fit, and what it found besides what was found in the images."""
    for one in filter(None, retraces):
        typer.echo(
            f"retrace             {one.provenance['channel']!r}: the difference is noise"
        )
    printed = {one.kind for image in images for one in image.findings}
    for one in fit.findings:
        if one.kind not in printed:
            typer.echo(one.line())
    typer.echo(f"{fit.text()}\n")


def _print_channel(maker: Measured, image: Image) -> None:
    """Print which channel was read, and which others there are."""
    name = image.steps[0].get("channel")
    if name is None:
        return
    others = [repr(other) for other in maker.channels() if other != name]
    choice = f"; --channel takes another: {', '.join(others)}" if others else ""
    typer.echo(f"{'channel':<19} {name!r}{choice}")
