"""The command infer with its options, and what show prints of its result."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from chemage.cli import completion, output, terminal
from chemage.cli.files import drawn, figures_of, preflight_folder, protect_inputs, result_written
from chemage.cli.options import RESULTS, ForceOpt, JsonOpt, SetOpt, ThreadsOpt, changed_fields, check_ending, user_error
from chemage.foundation.progress import loading, progress_bars, reported

if TYPE_CHECKING:
    from chemage.cli.infer_words import Wishes
    from chemage.foundation.progress import Report
    from chemage.inference.curves import MeasuredCurve
    from chemage.inference.result import Inference, InferenceResult, UnexplainedError
    from chemage.scene.scene import Scene

#: width of the tables
_WIDTH = 80

MeasuredArg = Annotated[
    list[Path],
    typer.Argument(
        metavar="MEASURED.csv",
        help="measured curves of ageing: CSV files with the columns hold_time (s), friction_drop (nN) or "
        "friction_coefficient_drop, error, load (nN), temperature (K)",
    ),
]
SceneOpt = Annotated[
    str,
    typer.Option(
        metavar="SCENE",
        autocompletion=completion.scenes,
        help="what is known of the contact: a scene file (.toml), or the name of an installed scene; its "
        "[forming], load, temperature and hold times are not used",
    ),
]
LoadOpt = Annotated[
    str | None, typer.Option(metavar="FORCE", help='load of curves without a column load, such as "50 nN"')
]
TemperatureOpt = Annotated[
    str | None,
    typer.Option(metavar="TEMPERATURE", help='temperature of curves without a column temperature, such as "300 K"'),
]
RelativeErrorOpt = Annotated[
    str | None,
    typer.Option(metavar="SHARE", help='standard error over the value of curves without a column error, such as "3 %"'),
]
UnknownOpt = Annotated[
    list[str] | None,
    typer.Option(
        metavar="NAME",
        help="infer this value too, within default bounds or given ones: bond_force, activation_volume, "
        'attempt_frequency, or "bond_force=1 nN to 10 nN"; may be repeated; default: none',
    ),
]
FamiliesOpt = Annotated[
    str | None,
    typer.Option(
        metavar="NAMES",
        help="parametric densities to compare, separated by commas, or none; default: all of them",
    ),
]
PredictOpt = Annotated[
    list[str] | None,
    typer.Option(
        metavar="CONDITIONS",
        help='forecast at other conditions, such as "load=500 nN, temperature=350 K, hold_time=1 s to 1e6 s" or '
        '"scene=rough.toml, load=20 uN"; what is not given is as in the scene; may be repeated',
    ),
]
NextOpt = Annotated[
    list[str] | None,
    typer.Option(
        "--next",
        metavar="FILE|CONDITIONS",
        help="planned measurements to rank by how much they narrow the result: a CSV file with the columns "
        'hold_time (s), load (nN), temperature (K), error (nN), or "hold_time=1 ms to 1e7 s, load=50 nN"; may be '
        "repeated",
    ),
]
TargetOpt = Annotated[
    str | None,
    typer.Option(
        metavar="CONDITIONS",
        help='what they are to narrow: "energy=1.0 eV", or a forecast, "load=500 nN, hold_time=1e5 s"; default: '
        "the density at all visible energies",
    ),
]
SamplesOpt = Annotated[int, typer.Option(min=50, metavar="N", help="samples of the posterior that are kept")]
SeedOpt = Annotated[int, typer.Option(min=0, metavar="N", help="seed of sampling and of the simulated kinetics")]
OutOpt = Annotated[
    Path | None,
    typer.Option(
        "--out",
        "-o",
        metavar="FILE",
        help="result file, ending in .h5 or .hdf5; default: NAME-inferred.h5, after the first CSV file",
    ),
]


def infer(
    measured: MeasuredArg,
    scene: SceneOpt,
    changes: SetOpt = None,
    load: LoadOpt = None,
    temperature: TemperatureOpt = None,
    relative_error: RelativeErrorOpt = None,
    unknown: UnknownOpt = None,
    families: FamiliesOpt = None,
    predict: PredictOpt = None,
    planned: NextOpt = None,
    target: TargetOpt = None,
    samples: SamplesOpt = 1000,
    seed: SeedOpt = 0,
    threads: ThreadsOpt = None,
    out: OutOpt = None,
    figures: Annotated[bool, typer.Option(help="draw figures into the folder NAME-figures beside the result")] = True,
    as_json: JsonOpt = False,
    force: ForceOpt = False,
) -> None:
    """Infer the density of reaction barriers from measured ageing.

    Prints the density with its bands, what the data can see at all, forecasts, and which measurement would narrow them
    most. The result file can be used in scenes: forming = { kind = "inferred", path = "NAME.h5" }.
    """
    loading("loading chemage")
    from chemage.cli import infer_words
    from chemage.foundation.files import preflight
    from chemage.foundation.result import result_of
    from chemage.foundation.units import convert
    from chemage.inference.result import UnexplainedError
    from chemage.scene.files import load_scene

    path = out or Path(f"{measured[0].stem}-inferred.h5")
    if out is not None:
        check_ending(out, RESULTS, "a result file")
    wishes = infer_words.read_wishes(predict or (), planned or (), target)
    how: dict[str, Any] = {
        "unknown": infer_words.read_unknowns(unknown or ()),
        "families": infer_words.read_families(families),
        "samples": samples,
        "seed": seed,
        "threads": threads,
    }
    there = load_scene(scene, changed_fields(changes))
    protect_inputs(path, scene, there)
    _protect(path, [*measured, *(Path(text) for text in planned or () if "=" not in text)])
    share = None if relative_error is None else convert(relative_error, "", "--relative-error")
    curves = _curves(measured, load, temperature, share)
    preflight(path, force=force)
    if figures:
        preflight_folder(figures_of(path), force)
    try:
        result, pictures = _computed(curves, there, wishes, how, path, figures=figures, force=force)
    except UnexplainedError as error:
        _show_best_fit(error, curves)
        raise
    hint = f'use it   forming = {{ kind = "inferred", path = "{path}" }}'
    terminal.answer(result_of(result), as_json, [hint], file=path, figures=pictures)


def _protect(path: Path, inputs: Sequence[Path]) -> None:
    for file in inputs:
        if os.path.realpath(file) == os.path.realpath(path):
            raise user_error(f"{path} is an input of this command; choose another --out")


def _curves(
    files: Sequence[Path], load: str | None, temperature: str | None, share: float | None
) -> tuple[MeasuredCurve, ...]:
    from chemage.inference.curves import check_curves, read_curves

    how: dict[str, Any] = {"load": load, "temperature": temperature, "relative_error": share}
    curves = tuple(curve for file in files for curve in read_curves(file, **how))
    check_curves(curves)
    return curves


def _computed(
    curves: tuple[MeasuredCurve, ...],
    scene: Scene,
    wishes: Wishes,
    how: dict[str, Any],
    path: Path,
    *,
    figures: bool,
    force: bool,
) -> tuple[InferenceResult, list[Path]]:
    """Infer, forecast, rank, write and draw."""
    from chemage.foundation.result import result_of
    from chemage.inference import infer as inferring
    from chemage.results.files import write_inference

    pictures: list[Path] = []
    with progress_bars({"families": "fits"}) as report:
        inference = inferring.infer(curves, scene, progress=report, **how)
        result = _with_wishes(inference, wishes, report)
        with reported(report, "writing"):
            write_inference(path, result, force=force)
        if figures:
            with result_written(path), reported(report, "drawing"):
                pictures = drawn(result_of(result), path)
    return result, pictures


def _with_wishes(inference: Inference, wishes: Wishes, report: Report) -> InferenceResult:
    """The forecasts, and the planned measurements in their order."""
    from chemage.inference.result import InferenceResult

    forecasts, total = {}, len(wishes.forecasts)
    for number, (label, arguments) in enumerate(wishes.forecasts.items()):
        report("forecasts", number, total)
        forecasts[label] = inference.forecast(**arguments)
    if total:
        report("forecasts", total, total)
    ranked: list[dict[str, Any]] = []
    if wishes.candidates:
        with reported(report, "planned measurements"):
            ranked = inference.next_experiment(wishes.candidates, target=wishes.target)
    return InferenceResult(inference, forecasts, tuple(ranked), wishes.target_text if ranked else "")


def _show_best_fit(error: UnexplainedError, curves: Sequence[MeasuredCurve]) -> None:
    """Print measured values beside the best fit on stderr, for data that no density explains."""
    if output.quiet():
        return
    points = [(c.name, t, v) for c in curves for t, v in zip(c.hold_times, c.friction_drop, strict=True)]
    if len(points) != len(error.fitted):
        return
    terminal.say("the best fit:", file=sys.stderr)
    terminal.say(
        f"{'curve':16} {'hold time (s)':>13} {'measured (nN)':>13} {'fit (nN)':>10} {'residual':>9}", file=sys.stderr
    )
    for (name, time, value), fit, off in zip(points, error.fitted, error.residuals, strict=True):
        terminal.say(f"{name[:16]:16} {time:13.5g} {value:13.5g} {fit:10.5g} {off:+9.1f}", file=sys.stderr)
