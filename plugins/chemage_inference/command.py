"""The command infer: what it reads from its options, and what it computes and prints."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from chemage.plugin import completion, options, output, progress

if TYPE_CHECKING:
    from chemage import Scene
    from chemage.plugin import progress
    from chemage_inference.curves import MeasuredCurve
    from chemage_inference.result import (
        Inference,
        InferenceResult,
        UnexplainedError,
    )

#: hold times per decade of a range, in a forecast and among planned measurements
PER_DECADE, PLANNED_PER_DECADE = 4, 1


@dataclass(frozen=True)
class Wishes:
    """What is asked of an inference beside the density, checked before anything is computed."""

    #: label -> arguments of :meth:`Inference.forecast`
    forecasts: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    candidates: Sequence[Mapping[str, Any]] = ()
    target: Mapping[str, Any] | None = None
    #: the target in words
    target_text: str = ""


def read_wishes(
    predict: Sequence[str], planned: Sequence[str], target: str | None
) -> Wishes:
    """Read ``--predict``, ``--next`` and ``--target``.

    Raises
    ------
    InputError
        Naming the option, the word that is wrong, and how to write it.
    """
    from chemage_inference.forecast import checked_target
    from chemage_inference.result import MOST_FORECASTS

    forecasts: dict[str, Mapping[str, Any]] = {}
    for text in predict:
        arguments = _forecast(text)
        parts = [part.strip() for part in text.split(",") if part.strip()]
        # the last hold time stands beside the label
        label = (
            ", ".join(part for part in parts if not part.startswith("hold_time"))
            or "as in the scene"
        )
        label = label if label not in forecasts else ", ".join(parts)
        if label in forecasts:
            raise options.user_error(f"--predict {text}: given twice")
        forecasts[label] = arguments
    if len(forecasts) > MOST_FORECASTS:
        raise options.user_error(
            f"--predict: {len(forecasts)} forecasts; one file holds {MOST_FORECASTS}"
        )
    candidates = [plan for text in planned for plan in _candidates(text)]
    if target is not None and not candidates:
        raise options.user_error(
            "--target is what planned measurements are to narrow; give them with --next"
        )
    if target is None:
        everything = "the density at all visible energies"
        return Wishes(forecasts, candidates, None, everything)
    wanted = checked_target("--target", _pairs("--target", target))
    return Wishes(forecasts, candidates, wanted, target.strip())


def read_unknowns(texts: Sequence[str]) -> dict[str, tuple[str, str]] | list[str]:
    """Read ``--unknown NAME`` and ``--unknown "NAME=LOW to HIGH"``: names, or names with their bounds."""
    names: list[str] = []
    bounds: dict[str, tuple[str, str]] = {}
    for text in texts:
        name, equals, value = (part.strip() for part in text.partition("="))
        if name in names:
            raise options.user_error(f"--unknown {text}: {name} is given twice")
        names.append(name)
        if equals:
            low, to, high = (part.strip() for part in value.partition(" to "))
            if not (low and to and high):
                raise options.user_error(
                    f'--unknown {text}: write the bounds as LOW to HIGH, such as "bond_force=1 nN to 10 nN"'
                )
            bounds[name] = low, high
    if bounds and len(bounds) < len(names):
        bare = ", ".join(name for name in names if name not in bounds)
        raise options.user_error(
            f"--unknown {bare}: give bounds for all unknowns, or for none"
        )
    return bounds or names


def read_calibration(text: str | None) -> Any:
    """Read ``--calibration "10 %"`` or ``"force=10 %, drift=2 %, offset=0.5 nN, load=5 %"``."""
    if text is None or "=" not in text:
        return text or 0.0
    return _pairs("--calibration", text)


def read_families(text: str | None) -> Sequence[str]:
    """Read ``--families NAME,NAME`` or ``none``."""
    from chemage_inference.infer import FAMILIES

    if text is None:
        return FAMILIES
    names = [name.strip() for name in text.split(",") if name.strip()]
    return () if names == ["none"] else tuple(dict.fromkeys(names))


def _forecast(text: str) -> Mapping[str, Any]:
    from chemage import load_scene
    from chemage_inference.forecast import stated

    words = _pairs("--predict", text)
    arguments: dict[str, Any] = {}
    if (where := words.pop("scene", None)) is not None:
        arguments["scene"] = load_scene(str(where))
    if (time := words.pop("hold_time", None)) is not None:
        arguments["hold_times"] = _times("--predict", time, PER_DECADE)
    return arguments | stated(
        "--predict", words, ("load", "temperature", "hold_time", "scene")
    )


def _candidates(text: str) -> list[dict[str, Any]]:
    from chemage_inference.forecast import PLAN, stated

    if text.strip().lower().endswith(".csv") or (
        "=" not in text and Path(text).exists()
    ):
        return _from_file(Path(text))
    words = _pairs("--next", text)
    time = words.pop("hold_time", None)
    same = stated("--next", words, PLAN)
    if time is None:
        raise options.user_error(
            f'--next {text}: give a hold time, such as "hold_time=1e5 s", or a CSV file'
        )
    return [
        {"hold_time": one, **same}
        for one in _times("--next", time, PLANNED_PER_DECADE)
    ]


def _from_file(path: Path) -> list[dict[str, Any]]:
    """Planned measurements in a CSV file: columns hold_time (s), load (nN), temperature (K), error (nN)."""
    from chemage.plugin import read_columns
    from chemage_inference.forecast import PLAN, STATED, stated

    example = ", ".join(f"{name} ({STATED[name][0]})" for name in PLAN)
    table = read_columns(path, PLAN, example)
    if not table.rows:
        raise options.user_error(
            f"--next {path}: no planned measurements; write a header, such as {example}, and a row for each"
        )
    if "hold_time" not in table.columns:
        raise options.user_error(
            f"--next {path}: no column hold_time; write the header as {example}"
        )
    for note in table.notes:
        output.remark(f"note: {path}: {note}")
    plans = []
    for row in table.rows:
        plan = {}
        for name, (heading, *_) in table.columns.items():
            if row[2][heading.place] == "":
                continue
            share = name == "error" and heading.unit == "%"
            number = table.number(row, name, "" if share else STATED[name][0])
            plan[name] = f"{100 * number:g} %" if share else number
        plans.append(stated(f"--next {row[1]}", plan, PLAN))
    return plans


def _pairs(option: str, text: str) -> dict[str, float | str]:
    """Read ``name=value, name=value``; a number alone is in internal units."""
    example = (
        f'write it as NAME=VALUE, such as {option} "load=50 nN, hold_time=1e5 s"'
    )
    words: dict[str, float | str] = {}
    for part in filter(None, (piece.strip() for piece in text.split(","))):
        name, equals, value = (piece.strip() for piece in part.partition("="))
        name = {"hold_times": "hold_time"}.get(name, name)
        if not equals or not value:
            raise options.user_error(f"{option} {text}: {part!r}; {example}")
        if name in words:
            raise options.user_error(f"{option} {text}: {name} is given twice")
        words[name] = _number(value)
    if not words:
        raise options.user_error(f"{option}: nothing given; {example}")
    return words


def _number(value: str) -> float | str:
    try:
        return float(value)
    except ValueError:
        return value


def _times(option: str, value: float | str, per_decade: int) -> list[float]:
    from chemage import ChemageError, hold_times
    from chemage_inference.forecast import stated

    low, to, high = (part.strip() for part in str(value).partition(" to "))
    if not to:
        return [stated(option, {"hold_time": value}, ("hold_time",))["hold_time"]]
    try:
        return hold_times(_number(low), _number(high), per_decade).tolist()
    except ChemageError as error:
        raise options.user_error(f"{option}: hold_time={value}: {error}") from None


MeasuredArg = Annotated[
    list[Path],
    typer.Argument(
        metavar="MEASURED",
        help="measured curves of ageing: text or Excel files with the columns hold_time (s), friction_drop (nN) or "
        "friction_coefficient_drop, error, load (nN), temperature (K); or results of chemage (.h5), with the errors of "
        "their replicas or surfaces",
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
    str | None,
    typer.Option(
        metavar="FORCE",
        help='load of curves without a column load, such as "50 nN"',
    ),
]
TemperatureOpt = Annotated[
    str | None,
    typer.Option(
        metavar="TEMPERATURE",
        help='temperature of curves without a column temperature, such as "300 K"',
    ),
]
RelativeErrorOpt = Annotated[
    str | None,
    typer.Option(
        metavar="SHARE",
        help='standard error over the value of curves without a column error, such as "3 %"',
    ),
]
UnknownOpt = Annotated[
    list[str] | None,
    typer.Option(
        metavar="NAME",
        help="infer this value too, within default bounds or given ones: bond_force, activation_volume, "
        'attempt_frequency, or "bond_force=1 nN to 10 nN"; may be repeated; default: none',
    ),
]
ErrorsOpt = Annotated[
    str,
    typer.Option(
        metavar="NAMES",
        help="what is inferred of the errors, separated by commas: scaled (a factor of the stated ones, of each "
        "curve), robust (which points are off), correlated (along each curve); or as-stated",
    ),
]
CalibrationOpt = Annotated[
    str | None,
    typer.Option(
        metavar="SHARE",
        help='standard error of a factor that all forces of an instrument share, "10 %", or also of its drift per '
        'decade of the hold time, of an offset, and of a factor of the loads, "force=10 %, drift=2 %, offset=0.5 nN, '
        'load=5 %"; default: none',
    ),
]
CalibrateOpt = Annotated[
    int | None,
    typer.Option(
        min=10,
        metavar="N",
        help="infer N simulated truths measured at the hold times and errors of these curves instead, and print how "
        "often the bands hold them",
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
        help="planned measurements to rank by how much they narrow the result: a table with the columns "
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
SamplesOpt = Annotated[
    int,
    typer.Option(
        min=50, metavar="N", help="samples of the posterior that are kept"
    ),
]
SeedOpt = Annotated[
    int,
    typer.Option(
        min=0, metavar="N", help="seed of sampling and of the simulated kinetics"
    ),
]
OutOpt = Annotated[
    Path | None,
    typer.Option(
        "--out",
        "-o",
        metavar="FILE",
        help="result file, ending in .h5 or .hdf5; default: NAME-inferred.h5, after the first table",
    ),
]


def infer(
    measured: MeasuredArg,
    scene: SceneOpt,
    changes: options.SetOpt = None,
    load: LoadOpt = None,
    temperature: TemperatureOpt = None,
    relative_error: RelativeErrorOpt = None,
    offset: options.OffsetOpt = None,
    sheet: options.SheetOpt = None,
    unknown: UnknownOpt = None,
    errors: ErrorsOpt = "scaled,robust",
    calibration: CalibrationOpt = None,
    calibrate: CalibrateOpt = None,
    families: FamiliesOpt = None,
    predict: PredictOpt = None,
    planned: NextOpt = None,
    target: TargetOpt = None,
    samples: SamplesOpt = 1000,
    seed: SeedOpt = 0,
    threads: options.ThreadsOpt = None,
    out: OutOpt = None,
    figures: options.FiguresOpt = True,
    as_json: options.JsonOpt = False,
    force: options.ForceOpt = False,
) -> None:
    """Infer the density of reaction barriers from measured ageing.

    Prints the density with its bands, what the data can see at all, forecasts, and which measurement would narrow them
    most. The result file can be used in scenes: forming = { kind = "inferred", path = "NAME.h5" }.
    """
    progress.loading("loading chemage")
    from chemage import load_scene
    from chemage.plugin import convert
    from chemage_inference.display import InferenceDisplay
    from chemage_inference.result import UnexplainedError

    path = out or Path(f"{measured[0].stem}-inferred.h5")
    if out is not None:
        options.check_ending(out, options.RESULTS, "a result file")
    wishes = read_wishes(predict or (), planned or (), target)
    how: dict[str, Any] = {
        "unknown": read_unknowns(unknown or ()),
        "errors": [name.strip() for name in errors.split(",")],
        "calibration": read_calibration(calibration),
        "families": read_families(families),
        "samples": samples,
        "seed": seed,
        "threads": threads,
    }
    there = load_scene(scene, options.changed_fields(changes))
    plans = (text for text in planned or () if "=" not in text)
    output.protect_inputs(path, scene, there, *measured, *plans)
    lacking: dict[str, Any] = {
        "load": load,
        "temperature": temperature,
        "offset": offset,
        "sheet": sheet,
    }
    if relative_error is not None:
        share = convert(relative_error, "", "--relative-error")
        lacking["relative_error"] = share
    curves = _curves(measured, lacking)
    if calibrate is not None:
        del how["unknown"], how["families"], how["samples"]
        _calibrated(curves, there, calibrate, how, as_json)
        return
    output.preflight_result(path, force=force, figures=figures)
    try:
        result, pictures = _computed(
            curves, there, wishes, how, path, figures=figures, force=force
        )
    except UnexplainedError as error:
        _show_best_fit(error, curves)
        if figures:
            drawn = _drawn_residuals(error, curves, path)
            output.say(f"residuals of the best fit: {drawn}", file=sys.stderr)
        raise
    hint = f'use it   forming = {{ kind = "inferred", path = "{path}" }}'
    shown = InferenceDisplay(result)
    output.answer(shown, as_json, [hint], file=path, figures=pictures)


def _calibrated(
    curves: tuple[MeasuredCurve, ...],
    scene: Scene,
    count: int,
    how: dict[str, Any],
    as_json: bool,
) -> None:
    """Print how often the bands of an inference of simulated truths hold these."""
    from chemage_inference.calibrate import LEVELS
    from chemage_inference.calibrate import calibrate as calibrating

    with progress.progress_bars() as report:
        found = calibrating(curves, scene, count=count, progress=report, **how)
    if as_json:
        output.say_json(found.todict())
        return
    inside = (f"inside {100 * level:.0f} %" for level in LEVELS)
    columns = "quantity", "uniform, p", *inside
    title = f"{count} simulated truths, {found.refused} of them refused"
    output.show_rows(title, columns, found.rows())


def _curves(
    files: Sequence[Path], how: Mapping[str, Any]
) -> tuple[MeasuredCurve, ...]:
    from chemage_inference.curves import read_curves

    curves = tuple(curve for file in files for curve in read_curves(file, **how))
    for note in {
        f"{curve.name}: {note}": 0 for curve in curves for note in curve.notes
    }:
        output.remark(f"note: {note}")
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
    from chemage_inference import infer as inferring
    from chemage_inference.display import InferenceDisplay

    pictures: list[Path] = []
    with progress.progress_bars({"families": "fits"}) as report:
        inference = inferring.infer(curves, scene, progress=report, **how)
        result = _with_wishes(inference, wishes, report)
        with progress.reported(report, "writing"):
            result.write(path, force=force)
        if figures:
            with output.result_written(path), progress.reported(report, "drawing"):
                pictures = output.drawn(InferenceDisplay(result), path)
    return result, pictures


def _with_wishes(
    inference: Inference, wishes: Wishes, report: progress.Report
) -> InferenceResult:
    """The forecasts, and the planned measurements in their order."""
    from chemage_inference.result import InferenceResult

    forecasts, total = {}, len(wishes.forecasts)
    for number, (label, arguments) in enumerate(wishes.forecasts.items()):
        report("forecasts", number, total)
        forecasts[label] = inference.forecast(**arguments)
    if total:
        report("forecasts", total, total)
    ranked: list[dict[str, Any]] = []
    if wishes.candidates:
        with progress.reported(report, "planned measurements"):
            ranked = inference.next_experiment(
                wishes.candidates, target=wishes.target
            )
    return InferenceResult(
        inference, forecasts, tuple(ranked), wishes.target_text if ranked else ""
    )


def _show_best_fit(
    error: UnexplainedError, curves: Sequence[MeasuredCurve]
) -> None:
    """Print measured values beside the best fit on stderr, for data that no density explains."""
    lines = [
        "the best fit:",
        f"{'curve':16} {'hold time (s)':>13} {'measured (nN)':>13} {'fit (nN)':>10} {'residual':>9}",
    ]
    points = (
        (curve.name[:16], *point)
        for curve in curves
        for point in zip(curve.hold_times, curve.friction_drop, strict=True)
    )
    for point in zip(points, error.fitted, error.residuals, strict=True):
        (name, time, value), fit, off = point
        lines.append(
            f"{name:16} {time:13.5g} {value:13.5g} {fit:10.5g} {off:+9.1f}"
        )
    if not output.quiet():
        output.say("\n".join(lines), file=sys.stderr)


def _drawn_residuals(
    error: UnexplainedError, curves: Sequence[MeasuredCurve], path: Path
) -> Path:
    """Draw the residuals of the best fit into the folder of figures."""
    import numpy as np

    from chemage.plugin import figures

    figure, (axes,) = figures.panels(6.4, 3.4)
    axes.axhspan(-2, 2, color=figures.GREY, alpha=0.15)
    ends = np.cumsum([curve.hold_times.size for curve in curves])
    parts = np.split(error.residuals, ends[:-1])
    for curve, here in zip(curves, parts, strict=True):
        axes.plot(curve.hold_times, here, "o-", label=figures.plain(curve.name))
    axes.set(xscale="log", xlabel="hold time (s)")
    axes.set(ylabel="residual (stated standard errors)")
    figures.legend(axes)
    folder = output.figures_of(path)
    return figures.save_figures({"residuals": figure}, folder, force=True)[0]
