"""The command infer: what it reads from its options, and what it computes and prints."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from chemage.plugin import completion, options, output, progress

if TYPE_CHECKING:
    from chemage import Scene
    from chemage.plugin import progress
    from chemage_inference.curves import MeasuredCurve
    from chemage_inference.result import InferenceResult, UnexplainedError

#: hold times per decade of a range, in a forecast and among planned measurements
PER_DECADE, PLANNED_PER_DECADE = 4, 1


def read_forecasts(texts: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Read ``--predict``: label -> arguments of :meth:`Inference.forecast`."""
    from chemage import load_scene
    from chemage_inference.forecast import stated
    from chemage_inference.result import MOST_FORECASTS

    forecasts: dict[str, dict[str, Any]] = {}
    for text in texts:
        words = _pairs("--predict", text)
        # the last hold time stands beside the label
        parts = [part.strip() for part in text.split(",") if part.strip()]
        named = [part for part in parts if not part.startswith("hold_time")]
        label = ", ".join(named) or "as in the scene"
        if label in forecasts:
            label = ", ".join(parts)
        if label in forecasts:
            raise options.user_error(f"--predict {text}: given twice")
        asked = forecasts[label] = {}
        if "scene" in words:
            asked["scene"] = load_scene(str(words.pop("scene")))
        if "hold_time" in words:
            time = words.pop("hold_time")
            asked["hold_times"] = _times("--predict", time, PER_DECADE)
        known = "load", "temperature", "hold_time", "scene"
        asked |= stated("--predict", words, known)
    if len(forecasts) > MOST_FORECASTS:
        raise options.user_error(
            f"--predict: {len(forecasts)} forecasts; one file holds {MOST_FORECASTS}"
        )
    return forecasts


def read_plans(text: str) -> list[dict[str, Any]]:
    """Read ``--next``, conditions or a table, as planned measurements for :meth:`Inference.next_experiment`."""
    from chemage_inference.forecast import PLAN, stated

    path = Path(text)
    if text.strip().lower().endswith(".csv") or ("=" not in text and path.exists()):
        return _plans_in(path)
    words = _pairs("--next", text)
    time = words.pop("hold_time", None)
    same = stated("--next", words, PLAN)
    if time is None:
        raise options.user_error(
            f'--next {text}: give a hold time, such as "hold_time=1e5 s", or a CSV file'
        )
    times = _times("--next", time, PLANNED_PER_DECADE)
    return [{"hold_time": one, **same} for one in times]


def read_unknowns(texts: Sequence[str]) -> dict[str, tuple[str, str]] | list[str]:
    """Read ``--unknown NAME`` and ``--unknown "NAME=LOW to HIGH"``: names, or names with their bounds."""
    found: dict[str, tuple[str, str] | None] = {}
    for text in texts:
        name, equals, value = (part.strip() for part in text.partition("="))
        if name in found:
            raise options.user_error(f"--unknown {text}: {name} is given twice")
        found[name] = _ends(value)
        if equals and not found[name]:
            raise options.user_error(
                f'--unknown {text}: write the bounds as LOW to HIGH, such as "bond_force=1 nN to 10 nN"'
            )
    bounds = {name: ends for name, ends in found.items() if ends}
    bare = [name for name in found if name not in bounds]
    if bounds and bare:
        raise options.user_error(
            f"--unknown {', '.join(bare)}: give bounds for all unknowns, or for none"
        )
    return bounds or bare


def _names(text: str) -> list[str]:
    """Names between commas, each once."""
    names = (name.strip() for name in text.split(","))
    return list(dict.fromkeys(filter(None, names)))


def _plans_in(path: Path) -> list[dict[str, Any]]:
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
        plan: dict[str, Any] = {}
        for name, (heading, *_) in table.columns.items():
            if row[2][heading.place] == "":
                continue
            if name == "error" and heading.unit == "%":
                plan[name] = f"{100 * table.number(row, name, ''):g} %"
            else:
                plan[name] = table.number(row, name, STATED[name][0])
        plans.append(stated(f"--next {row[1]}", plan, PLAN))
    return plans


def _pairs(option: str, text: str) -> dict[str, float | str]:
    """Read ``name=value, name=value``; a number alone is in internal units."""
    example = (
        f'write it as NAME=VALUE, such as {option} "load=50 nN, hold_time=1e5 s"'
    )
    words: dict[str, float | str] = {}
    for part in filter(None, (piece.strip() for piece in text.split(","))):
        name, _, value = (piece.strip() for piece in part.partition("="))
        if name == "hold_times":
            name = "hold_time"
        if not value:
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


def _ends(text: str) -> tuple[str, str] | None:
    """The ends of ``LOW to HIGH``."""
    low, _, high = (part.strip() for part in text.partition(" to "))
    return (low, high) if low and high else None


def _times(option: str, value: float | str, per_decade: int) -> list[float]:
    from chemage import ChemageError, hold_times
    from chemage_inference.forecast import stated

    ends = _ends(str(value))
    if ends is None:
        return [stated(option, {"hold_time": value}, ("hold_time",))["hold_time"]]
    low, high = map(_number, ends)
    try:
        return hold_times(low, high, per_decade).tolist()
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
    from chemage_inference.forecast import checked_target
    from chemage_inference.infer import FAMILIES
    from chemage_inference.result import UnexplainedError

    path = out or Path(f"{measured[0].stem}-inferred.h5")
    if out is not None:
        options.check_ending(out, options.RESULTS, "a result file")
    wishes: dict[str, Any] = {"forecasts": read_forecasts(predict or ())}
    wishes["plans"] = [plan for text in planned or () for plan in read_plans(text)]
    if target is not None:
        if not planned:
            raise options.user_error(
                "--target is what planned measurements are to narrow; give them with --next"
            )
        wishes["target"] = target.strip()
        wanted = checked_target("--target", _pairs("--target", target))
        wishes["wanted"] = wanted
    how: dict[str, Any] = {
        "errors": _names(errors),
        "calibration": calibration or 0.0,
        "seed": seed,
        "threads": threads,
    }
    if "=" in (calibration or ""):
        how["calibration"] = _pairs("--calibration", str(calibration))
    unknowns = read_unknowns(unknown or ())
    chosen = FAMILIES if families is None else _names(families)
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
        _calibrated(curves, there, calibrate, how, as_json)
        return
    output.preflight_result(path, force=force, figures=figures)
    how |= {"unknown": unknowns, "samples": samples}
    how["families"] = () if chosen == ["none"] else tuple(chosen)
    pictures: list[Path] = []
    try:
        with progress.progress_bars({"families": "fits"}) as report:
            result = _computed(curves, there, how, report, **wishes)
            shown = InferenceDisplay(result)
            with progress.reported(report, "writing"):
                result.write(path, force=force)
            if figures:
                with (
                    output.result_written(path),
                    progress.reported(report, "drawing"),
                ):
                    pictures = output.drawn(shown, path)
    except UnexplainedError as error:
        _show_best_fit(error, curves)
        if figures:
            drawn = _drawn_residuals(error, curves, path)
            output.say(f"residuals of the best fit: {drawn}", file=sys.stderr)
        raise
    hint = f'use it   forming = {{ kind = "inferred", path = "{path}" }}'
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
    notes = (f"{curve.name}: {note}" for curve in curves for note in curve.notes)
    for note in dict.fromkeys(notes):
        output.remark(f"note: {note}")
    return curves


def _computed(
    curves: tuple[MeasuredCurve, ...],
    scene: Scene,
    how: Mapping[str, Any],
    report: progress.Report,
    forecasts: Mapping[str, Mapping[str, Any]],
    plans: Sequence[Mapping[str, Any]],
    wanted: Mapping[str, Any] | None = None,
    target: str = "the density at all visible energies",
) -> InferenceResult:
    """The inference with its forecasts, and the planned measurements in their order."""
    from chemage_inference import infer as inferring
    from chemage_inference.result import InferenceResult

    inference = inferring.infer(curves, scene, progress=report, **how)
    made, total = {}, len(forecasts)
    for label, arguments in forecasts.items():
        report("forecasts", len(made), total)
        made[label] = inference.forecast(**arguments)
    if total:
        report("forecasts", total, total)
    if not plans:
        return InferenceResult(inference, made)
    with progress.reported(report, "planned measurements"):
        ranked = inference.next_experiment(plans, target=wanted)
    return InferenceResult(inference, made, tuple(ranked), target)


def _show_best_fit(
    error: UnexplainedError, curves: Sequence[MeasuredCurve]
) -> None:
    """Print measured values beside the best fit on stderr, for data that no density explains."""
    if output.quiet():
        return
    lines = [
        "the best fit:",
        f"{'curve':16} {'hold time (s)':>13} {'measured (nN)':>13} {'fit (nN)':>10} {'residual':>9}",
    ]
    points = [
        (curve.name[:16], *point)
        for curve in curves
        for point in zip(curve.hold_times, curve.friction_drop, strict=True)
    ]
    row = "{:16} {:13.5g} {:13.5g} {:10.5g} {:+9.1f}"
    for point, *fit in zip(points, error.fitted, error.residuals, strict=True):
        lines.append(row.format(*point, *fit))
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
