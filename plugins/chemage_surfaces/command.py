"""The command ``chemage roughness``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer


def roughness(
    path: Annotated[Path, typer.Argument(metavar="FILE", help="file of a measured image")],
    reader: Annotated[
        str | None, typer.Option(metavar="KIND", help="kind of the reader; default: by the ending of the file")
    ] = None,
    height_unit: Annotated[
        str | None, typer.Option(metavar="UNIT", help="unit of the heights, such as nm; default: as the file states")
    ] = None,
    pixel_size: Annotated[
        str | None,
        typer.Option(metavar="LENGTH", help="edge of a pixel, nm or with a unit; default: as the file states"),
    ] = None,
    detrend: Annotated[
        str | None,
        typer.Option(
            metavar="TREND",
            help="trend to subtract: none, mean, plane or quadratic; default: plane, or mean if periodic",
        ),
    ] = None,
    missing: Annotated[
        str, typer.Option(metavar="ACTION", help="what to do with missing heights: few, refuse or interpolate")
    ] = "few",
    spikes: Annotated[
        str, typer.Option(metavar="ACTION", help="what to do with spikes: few, refuse, keep or interpolate")
    ] = "few",
    periodic: Annotated[
        bool | None, typer.Option(help="whether the image is one period of the surface; default: as the file states")
    ] = None,
    resolution: Annotated[
        str | None,
        typer.Option(metavar="LENGTH", help="shortest wavelength of the fit, nm or with a unit; default: two pixels"),
    ] = None,
    spacing: Annotated[
        str | None,
        typer.Option(metavar="LENGTH", help="pixel size in the printed section; default: that of the image"),
    ] = None,
    cutoff: Annotated[
        str | None,
        typer.Option(metavar="LENGTH", help="shortest wavelength in the printed section; default: that of the fit"),
    ] = None,
) -> None:
    """Fit the roughness of a measured image.

    Prints rms height and slope, Hurst exponent and roll-off with their errors, and the section [surface] of a scene
    that makes random surfaces like the image, or why the fit makes none.
    """
    from chemage_surfaces.images import Measured
    from chemage_surfaces.roughness_fit import fit_roughness, section

    image: dict[str, Any] = {
        "path": str(path),
        "detrend": detrend or ("mean" if periodic else "plane"),
        "missing": missing,
        "spikes": spikes,
    }
    image |= {"reader": reader, "height_unit": height_unit, "pixel_size": pixel_size, "periodic": periodic}
    surface = Measured(**{name: value for name, value in image.items() if value is not None}).make()
    fit = fit_roughness(surface, resolution=resolution)
    typer.echo(fit.text() + "\n")
    if fit.fault:
        typer.echo(f"no section [surface]: {fit.fault}")
    else:
        typer.echo(section(fit.maker(pixel_size=spacing, cutoff=cutoff)))
