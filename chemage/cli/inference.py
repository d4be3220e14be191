"""The command infer, and what show prints of its result."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from chemage.cli import output, terminal
from chemage.cli.files import drawn, figures_of, preflight_folder, protect_inputs, result_written
from chemage.cli.infer_options import (
    FamiliesOpt,
    LoadOpt,
    MeasuredArg,
    NextOpt,
    OutOpt,
    PredictOpt,
    RelativeErrorOpt,
    SamplesOpt,
    SceneOpt,
    SeedOpt,
    TargetOpt,
    TemperatureOpt,
    UnknownOpt,
)
from chemage.cli.options import RESULTS, ForceOpt, JsonOpt, SetOpt, ThreadsOpt, changed_fields, check_ending, user_error
from chemage.foundation.progress import loading, progress_bars, reported

if TYPE_CHECKING:
    from chemage.cli.infer_words import Asked
    from chemage.inference.curves import MeasuredCurve
    from chemage.inference.inference import Inference
    from chemage.inference.result import InferenceResult
    from chemage.inference.unexplained import UnexplainedError
    from chemage.scene.scene import Scene


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
    from chemage.inference.unexplained import UnexplainedError
    from chemage.scene.scene_files import load_scene

    path = out or Path(f"{measured[0].stem}-inferred.h5")
    if out is not None:
        check_ending(out, RESULTS, "a result file")
    asked = infer_words.read_asked(predict or (), planned or (), target)
    how: dict[str, Any] = {
        "unknown": infer_words.read_unknowns(unknown or ()),
        "families": infer_words.read_families(families),
        "samples": samples,
        "seed": seed,
        "threads": threads,
    }
    one = load_scene(scene, changed_fields(changes))
    protect_inputs(path, scene, one)
    _protect(path, [*measured, *(Path(text) for text in planned or () if "=" not in text)])
    share = infer_words.read_share(relative_error)
    curves = _curves(measured, load, temperature, share)
    preflight(path, force=force)
    if figures:
        preflight_folder(figures_of(path), force)
    try:
        made, pictures = _computed(curves, one, asked, how, path, figures=figures, force=force)
    except UnexplainedError as error:
        _show_best_fit(error, curves)
        raise
    hint = f'use it   forming = {{ kind = "inferred", path = "{path}" }}'
    terminal.answer(result_of(made), as_json, [hint], file=path, figures=pictures)


def _protect(path: Path, inputs: Sequence[Path]) -> None:
    for given in inputs:
        if os.path.realpath(given) == os.path.realpath(path):
            raise user_error(f"{path} is an input of this command; choose another --out")


def _curves(
    files: Sequence[Path], load: str | None, temperature: str | None, share: float | None
) -> tuple[MeasuredCurve, ...]:
    from chemage.inference.curves import check_curves, read_curves

    found = [
        curve for file in files for curve in read_curves(file, load=load, temperature=temperature, relative_error=share)
    ]
    check_curves(found)
    return tuple(found)


def _computed(
    curves: tuple[MeasuredCurve, ...],
    scene: Scene,
    asked: Asked,
    how: dict[str, Any],
    path: Path,
    *,
    figures: bool,
    force: bool,
) -> tuple[InferenceResult, list[Path]]:
    """Infer, forecast, rank, write and draw."""
    from chemage.foundation.result import result_of
    from chemage.inference import infer as inferring
    from chemage.results.inference_files import write_inference

    pictures: list[Path] = []
    with progress_bars({"families": "fits"}, alive=True) as report:
        inference = inferring.infer(curves, scene, progress=report, **how)
        made = _asked_of(inference, asked, report)
        with reported(report, "writing"):
            write_inference(path, made, force=force)
        if figures:
            with result_written(path), reported(report, "drawing"):
                pictures = drawn(result_of(made), path)
    return made, pictures


def _asked_of(inference: Inference, asked: Asked, report: Any) -> InferenceResult:
    """The forecasts, and the planned measurements in their order."""
    from chemage.inference.result import InferenceResult

    forecasts, total = {}, len(asked.forecasts)
    for number, (label, arguments) in enumerate(asked.forecasts.items()):
        report("forecasts", number, total)
        forecasts[label] = inference.forecast(**arguments)
    if total:
        report("forecasts", total, total)
    ranked: list[dict[str, Any]] = []
    if asked.candidates:
        with reported(report, "planned measurements"):
            ranked = inference.next_experiment(asked.candidates, target=asked.target)
    return InferenceResult(inference, forecasts, tuple(ranked), asked.target_text if ranked else "")


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
