"""The command ``chemage roughness``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from chemage_surfaces.images import Image


Paths = Annotated[list[Path], typer.Argument(metavar="FILE...", help="images of one surface, at any magnifications")]
ReaderOption = Annotated[
    str | None, typer.Option(metavar="KIND", help="kind of the reader; default: by the content of the file")
]
HeightUnitOption = Annotated[
    str | None, typer.Option(metavar="UNIT", help="unit of the heights, such as nm; default: as the file states")
]
PixelSizeOption = Annotated[
    str | None,
    typer.Option(metavar="LENGTH", help="edge of a pixel, nm or with a unit; default: as the file states"),
]
LinesOption = Annotated[
    str, typer.Option(metavar="HOW", help="align scan lines: none, differences, constant, linear or quadratic")
]
ScarsOption = Annotated[str, typer.Option(metavar="ACTION", help="what to do with scars: keep or interpolate")]
DetrendOption = Annotated[
    str | None,
    typer.Option(
        metavar="TREND",
        help="trend to subtract: none, mean, plane or quadratic; default: plane, or mean if periodic",
    ),
]
MissingOption = Annotated[
    str, typer.Option(metavar="ACTION", help="what to do with missing heights: few, refuse or interpolate")
]
SpikesOption = Annotated[
    str, typer.Option(metavar="ACTION", help="what to do with spikes: few, refuse, keep or interpolate")
]
ResampleOption = Annotated[
    str | None, typer.Option(metavar="LENGTH", help="edge of square pixels to make; default: as they are")
]
PeriodicOption = Annotated[
    bool | None, typer.Option(help="whether the image is one period of the surface; default: as the file states")
]
ResolutionOption = Annotated[
    str | None,
    typer.Option(metavar="LENGTH", help="shortest wavelength of the fit; default: as far as the image is trusted"),
]
TipRadiusOption = Annotated[
    str | None,
    typer.Option(metavar="LENGTH", help="radius of the tip; default: as valleys sharper than peaks show it"),
]
RetraceOption = Annotated[
    bool, typer.Option(help="take the difference between trace and retrace, where the file has both, as noise")
]
SpacingOption = Annotated[
    str | None,
    typer.Option(metavar="LENGTH", help="pixel size in the printed section; default: that of the image"),
]
CutoffOption = Annotated[
    str | None,
    typer.Option(metavar="LENGTH", help="shortest wavelength in the printed section; default: that of the fit"),
]
FiguresOption = Annotated[
    Path | None, typer.Option(metavar="FOLDER", help="also draw FOLDER/roughness.png: spectrum and differences")
]
ForceOption = Annotated[bool, typer.Option("--force", help="overwrite the figure")]


def roughness(
    paths: Paths,
    reader: ReaderOption = None,
    height_unit: HeightUnitOption = None,
    pixel_size: PixelSizeOption = None,
    lines: LinesOption = "none",
    scars: ScarsOption = "keep",
    detrend: DetrendOption = None,
    missing: MissingOption = "few",
    spikes: SpikesOption = "few",
    resample: ResampleOption = None,
    periodic: PeriodicOption = None,
    resolution: ResolutionOption = None,
    tip_radius: TipRadiusOption = None,
    retrace: RetraceOption = True,
    spacing: SpacingOption = None,
    cutoff: CutoffOption = None,
    figures: FiguresOption = None,
    force: ForceOption = False,
) -> None:
    """Measure the roughness of an image, and fit it.

    Prints rms height, slope and curvature along both axes and by distance, of any image; then, of images that make a
    surface, Hurst exponent and roll-off with their errors, fitted to all of them together, and the section [surface] of
    a scene that makes random surfaces like them. Where there is no fit or no section, it says why.
    """
    from chemage_surfaces.images import Measured
    from chemage_surfaces.measures import measure
    from chemage_surfaces.roughness_fit import fit_roughness, section

    options: dict[str, Any] = {"reader": reader, "height_unit": height_unit, "pixel_size": pixel_size}
    options |= {"detrend": detrend or ("mean" if periodic else "plane"), "resample": resample, "periodic": periodic}
    options |= {"lines": lines, "scars": scars, "missing": missing, "spikes": spikes}
    options = {name: value for name, value in options.items() if value is not None}
    makers = [Measured(path=str(path), **options) for path in paths]
    images = [maker.image() for maker in makers]
    measures = [measure(image.heights, image.sides) for image in images]
    for path, image, found in zip(paths, images, measures, strict=True):
        typer.echo("\n".join([*([f"{path}:"] * (len(paths) > 1)), *_done(image), found.text(), ""]))
    fit, retraces, why = None, [], next((image.faults[0] for image in images if image.faults), "")
    if not why:
        from chemage import InputError

        surfaces = [image.surface() for image in images]
        retraces = [maker.retrace() if retrace and resolution is None else None for maker in makers]
        try:
            fit = fit_roughness(surfaces, resolution=resolution, tip_radius=tip_radius, retraces=retraces)
        except InputError as error:
            if resolution is not None or tip_radius is not None:
                raise
            why = str(error)
    if figures is not None:
        from chemage.plugin import figures as drawing
        from chemage_surfaces.roughness_figure import roughness_figure

        drawing.save_figures(
            {"roughness": roughness_figure([path.name for path in paths], images, measures, fit)}, figures, force=force
        )
    if fit is None:
        typer.echo(f"no fit: {why}")
        return
    typer.echo(
        "\n".join(
            [f"retrace             {one.provenance['channel']!r}: the difference is noise" for one in retraces if one]
            + [fit.text(), ""]
        )
    )
    if fit.fault:
        typer.echo(f"no section [surface]: {fit.fault}")
    else:
        typer.echo(section(fit.maker(pixel_size=spacing, cutoff=cutoff)))


def _done(image: Image) -> list[str]:
    """The steps that changed heights."""
    lines = []
    for step in image.steps:
        if step["step"] in ("lines", "scars", "spikes", "missing"):
            rest = ", ".join(f"{name} {value}" for name, value in step.items() if name != "step")
            lines.append(f"{step['step']:<19} {rest}")
    return lines
