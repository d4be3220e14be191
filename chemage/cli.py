"""The command line. Commands import what they need when they run, so that ``chemage --help`` is instant.

Exit status: 0 done, 1 a check found problems, 2 the user's input is wrong, 130 interrupted.
"""

from __future__ import annotations

import io
import json
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from chemage import terminal

if TYPE_CHECKING:
    from chemage.compare import Comparison
    from chemage.runs import Run
    from chemage.scene import Scene

app = typer.Typer(
    name="chemage",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    add_completion=False,
    rich_markup_mode=None,
    help="Chemical ageing of frictional contacts: from a rough surface or a tip to the static friction rise.",
)
plugins_app = typer.Typer(no_args_is_help=True, help="What is installed, where it comes from, and whether it works.")
app.add_typer(plugins_app, name="plugins")

SceneArg = Annotated[str, typer.Argument(help="a scene file (.toml), or the name of an installed scene")]
FileArg = Annotated[Path, typer.Argument(help="a result file (.h5)")]
JsonOpt = Annotated[bool, typer.Option("--json", help="print one JSON object instead of a table")]
ForceOpt = Annotated[bool, typer.Option("--force", help="overwrite what is already there")]
YesOpt = Annotated[bool, typer.Option("--yes", "-y", help="of a sweep: agree to many points and little room on disk")]
SetOpt = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="PATH=VALUE", help="change a field, e.g. --set surface.rms_slope=0.2; repeatable"),
]


def _version(wanted: bool) -> None:
    if wanted:
        from chemage import __version__

        print(f"chemage {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="print the version and exit")
    ] = False,
) -> None:
    pass


# -- run --------------------------------------------------------------------------------------------------------------


@app.command()
def run(
    scene: SceneArg,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="result file, default NAME.h5 here; folder of a sweep, default NAME-sweep"),
    ] = None,
    changes: SetOpt = None,
    replicas: Annotated[int | None, typer.Option(help="short for --set hold.replicas=N")] = None,
    seed: Annotated[int | None, typer.Option(help="of disorder and kinetics; short for --set hold.seed=N")] = None,
    workers: Annotated[
        int | None,
        typer.Option(min=1, help="threads for replicas; of a sweep, points at once; default one a processor"),
    ] = None,
    executor: Annotated[
        str | None, typer.Option(help="of a sweep: serial, processes, dask, dask:ADDRESS, dask:CLASS, dask:FILE.toml")
    ] = None,
    threads: Annotated[int | None, typer.Option(min=1, help="of a sweep: threads for each point")] = None,
    yes: YesOpt = False,
    checkpoints: Annotated[
        Path | None, typer.Option(help="folder to keep contact and replicas in as the run goes, and to go on from")
    ] = None,
    figures: Annotated[bool, typer.Option(help="draw the figures")] = True,
    as_json: JsonOpt = False,
    force: ForceOpt = False,
) -> None:
    """Carry a scene from surface to friction; write one result file and its figures. A scene with [sweep] fills a
    folder, and what is there already is not computed again."""
    from chemage import plots, runs, store
    from chemage.plan import plan
    from chemage.scene import is_sweep, load_scene

    if is_sweep(scene):
        from chemage.sweeps import cli as sweep_cli

        if checkpoints is not None:
            raise _user_error("--checkpoints is for a single run; a sweep goes on from its own folder anyway")

        return sweep_cli.run(
            scene,
            out,
            _changes(changes, replicas, seed),
            executor=executor or ("processes" if (workers or 1) > 1 else "serial"),
            workers=workers,
            threads=threads,
            yes=yes,
            as_json=as_json,
            force=force,
        )
    for option, given in (("--executor", executor), ("--threads", threads)):
        if given is not None:
            raise _user_error(f"{option} is for sweeps, and {scene} has no [sweep]; --workers are its threads")
    one = load_scene(scene, _changes(changes, replicas, seed))
    path = out or Path(f"{one.name}.h5")
    _spare_inputs(path, scene, one)
    store.preflight(path, force=force, size=plan(one).numbers.get("file", 0))
    folder = path.with_name(f"{path.stem}-figures")
    if figures:
        _preflight_folder(folder, force)
    pictures: list[Path] = []
    with terminal.progress_bars() as tell:
        result = runs.run(one, progress=tell, workers=workers, checkpoints=checkpoints)
        tell("writing", 0, 0)
        store.write(path, result, force=force)
        tell("writing", 1, 1)
        with _kept(path):
            if figures:
                tell("drawing", 0, 0)
                pictures = plots.save(result, folder, force=True)
                tell("drawing", 1, 1)
    if as_json:
        print(json.dumps({**result.summary(), "file": str(path), "figures": [str(p) for p in pictures]}))
        return
    _print_run(result)
    print(f"\nresult   {path}")
    for picture in pictures:
        print(f"figure   {picture}")


def _spare_inputs(path: Path, source: str, one: Scene) -> None:
    """Refuse to write over the scene file, or over a file that the scene reads, even with ``--force``."""
    read = [part["path"] for part in one.todict().values() if isinstance(part, dict) and "path" in part]
    for name in (source, *read):
        if os.path.realpath(name) == os.path.realpath(path):
            raise _user_error(f"{path} is what this scene is read from; choose another --out")


def _preflight_folder(folder: Path, force: bool) -> None:
    if not folder.exists():
        return
    if not folder.is_dir():
        raise _user_error(f"{folder}, the folder for the figures, is a file; choose another --out, or --no-figures")
    if not force and any(folder.iterdir()):
        raise _user_error(f"{folder} is already there; choose another --out, or overwrite with --force")


@contextmanager
def _kept(path: Path) -> Iterator[None]:
    """What goes wrong in here comes after the result was written, and the user is told so."""
    from chemage.errors import StoreError

    try:
        yield
    except StoreError as error:
        raise StoreError(f"{error}\nthe result itself is in {path}; `chemage plot {path}` draws its figures") from error
    except KeyboardInterrupt:
        raise KeyboardInterrupt(f"the result is in {path}, its figures are not all drawn") from None


def _changes(texts: list[str] | None, replicas: int | None = None, seed: int | None = None) -> dict[str, Any]:
    import tomllib

    changes: dict[str, Any] = {}
    for text in texts or []:
        path, equals, value = text.partition("=")
        if not equals or not path.strip():
            raise _user_error(f"--set {text}: write it as PATH=VALUE, such as surface.rms_slope=0.2")
        try:
            changes[path.strip()] = tomllib.loads(f"value = {value}")["value"]
        except tomllib.TOMLDecodeError:
            changes[path.strip()] = value.strip()
    if replicas is not None:
        changes["hold.replicas"] = replicas
    if seed is not None:
        changes["hold.seed"] = seed
    return changes


# -- check, show, plot ------------------------------------------------------------------------------------------------


@app.command()
def check(scene: SceneArg, changes: SetOpt = None, yes: YesOpt = False, as_json: JsonOpt = False) -> None:
    """Validate a scene, at every point of a sweep, and say what it needs and what it will cost; nothing is computed."""
    from chemage.plan import plan
    from chemage.runs import jsonable
    from chemage.scene import is_sweep, load_scene

    if is_sweep(scene):
        from chemage.sweeps import cli as sweep_cli

        return sweep_cli.check(scene, _changes(changes), yes=yes, as_json=as_json)
    made = plan(load_scene(scene, _changes(changes)))
    if as_json:
        print(json.dumps(jsonable(made.todict())))
        return
    table = terminal.table(f"{scene} is valid")
    for name, text in made.rows():
        table.add_row(name, text)
    terminal.show(table)
    for note in made.notes:
        print(f"note: {note}")


@app.command()
def status(folder: Annotated[Path, typer.Argument(help="the folder of a sweep")], as_json: JsonOpt = False) -> None:
    """Tell which points of a sweep are done, which failed and which are missing."""
    from chemage.sweeps import cli as sweep_cli

    sweep_cli.status(folder, as_json=as_json)


@app.command()
def show(file: FileArg, as_json: JsonOpt = False) -> None:
    """Print what is in a result file."""
    from chemage import store
    from chemage.runs import Run, jsonable

    thing = store.read(file)
    if isinstance(thing, Run):
        if as_json:
            print(json.dumps(thing.summary()))
        else:
            _print_run(thing)
        return
    fields = {
        name: f"array {value.shape} {value.dtype}" if hasattr(value, "shape") else value
        for name, value in thing.todict().items()
    }
    if as_json:
        print(json.dumps({"object": type(thing).__name__, **jsonable(fields)}, default=str))
        return
    table = terminal.table(f"{type(thing).__name__} in {file}")
    for name, value in fields.items():
        table.add_row(name, str(value))
    terminal.show(table)


@app.command()
def plot(
    file: FileArg,
    out: Annotated[Path | None, typer.Option("--out", "-o", help="folder; default FILE-figures")] = None,
    fmt: Annotated[str, typer.Option("--format", help="png, pdf or svg")] = "png",
    force: ForceOpt = False,
) -> None:
    """Draw the figures of a result file."""
    from chemage import plots, store
    from chemage.runs import Run

    if fmt not in ("png", "pdf", "svg"):
        raise _user_error(f"--format {fmt}: choose png, pdf or svg")
    thing = store.read(file)
    if not isinstance(thing, Run):
        raise _user_error(f"{file} holds one {type(thing).__name__}, not a run; `chemage run` makes files to plot")
    with terminal.progress_bars() as tell:
        tell("drawing", 0, 0)
        pictures = plots.save(thing, out or file.with_name(f"{file.stem}-figures"), force=force, suffix=fmt)
        tell("drawing", 1, 1)
    for picture in pictures:
        print(picture)


def _print_run(result: Run) -> None:
    from chemage.text import plus_minus

    contact, aging, fit = result.contact, result.aging, result.fit()
    (nx, ny), kind = contact.shape, result.scene["surface"]["kind"]
    table = terminal.table(result.scene.get("title") or result.name)
    rows: list[tuple[str, str]] = [
        (
            "surface",
            f"{kind}, {nx} x {ny} pixels of {contact.pixel_size:g} nm, rms slope {contact.rms_slope:.4g}",
        ),
        (
            "contact",
            f"{result.scene['contact']['kind']}, load {contact.load:g} nN, E* {contact.modulus:g} GPa"
            + ("" if contact.converged else "  NOT CONVERGED"),
        ),
        ("area fraction A/A0", f"{contact.area_fraction:.5f}"),
        ("kappa", f"{contact.kappa:.3f}"),
        ("patches", f"{contact.patches}"),
        ("perimeter to area C/A", f"{contact.perimeter_to_area:.4f} /nm"),
        ("mean contact pressure", f"{contact.mean_contact_pressure:.4g} GPa"),
    ]
    if aging is not None:
        last = f"at {aging.hold_times[-1]:g} s"
        rows += [
            ("sites", f"{aging.sites.mean():.0f}"),
            ("engine", f"{aging.engine}, {aging.replicas} replicas, {aging.events.sum()} events"),
            (f"friction drop {last}", plus_minus(aging.mean_friction_drop[-1], aging.friction_drop_stderr[-1], "nN")),
            (
                f"friction coefficient drop {last}",
                plus_minus(aging.mean_friction_coefficient_drop[-1], aging.friction_coefficient_drop_stderr[-1]),
            ),
        ]
    if fit is not None:
        rows.append(("beta", f"{plus_minus(fit.beta, fit.beta_stderr, 'per decade')}, {fit.points} hold times"))
        rows.append(("cut-off time", plus_minus(fit.cutoff_time, fit.cutoff_time_stderr, "s")))
    if result.timings:
        rows.append(("wall time", ", ".join(f"{stage} {seconds:.2f} s" for stage, seconds in result.timings.items())))
    for name, text in rows:
        table.add_row(name, text)
    terminal.show(table)
    for note in result.notes:
        print(f"note: {note}")


# -- compare, report --------------------------------------------------------------------------------------------------


@app.command()
def compare(
    files: Annotated[list[Path], typer.Argument(help="result files (.h5)")],
    as_json: JsonOpt = False,
    as_csv: Annotated[bool, typer.Option("--csv", help="print CSV, one line a file")] = False,
    figures: Annotated[Path | None, typer.Option(help="folder to draw the figures into")] = None,
    fmt: Annotated[str, typer.Option("--format", help="of the figures: png, pdf or svg")] = "png",
    measured: Annotated[
        list[Path] | None, typer.Option(help="CSV of hold time and friction drop to hold against them; repeatable")
    ] = None,
    at: Annotated[
        list[str] | None,
        typer.Option(metavar="TIME", help="hold time to compare at; repeatable; default 1 s and 1e3 s"),
    ] = None,
    force: ForceOpt = False,
) -> None:
    """Put result files side by side, single asperities and rough contacts alike, with measurements on top."""
    from chemage import compare as side_by_side

    if as_json and as_csv:
        raise _user_error("--json and --csv: choose one")
    if fmt not in ("png", "pdf", "svg"):
        raise _user_error(f"--format {fmt}: choose png, pdf or svg")
    made = side_by_side.compare_files(files, measured=measured or (), times=at or side_by_side.TIMES)
    pictures: list[Path] = []
    if figures is not None:
        with terminal.progress_bars() as tell:
            tell("drawing", 0, 0)
            pictures = made.save(figures, force=force, suffix=fmt)
            tell("drawing", 1, 1)
    if as_json:
        print(json.dumps({**made.todict(), "figures": [str(path) for path in pictures]}))
    elif as_csv:
        print(made.csv(), end="")
    else:
        _print_comparison(made)
        for picture in pictures:
            print(f"figure   {picture}")


@app.command()
def report(
    files: Annotated[list[Path], typer.Argument(help="result files (.h5); several are compared")],
    out: Annotated[Path, typer.Option("--out", "-o", help="the HTML file to write")] = Path("report.html"),
    measured: Annotated[
        list[Path] | None, typer.Option(help="CSV of hold time and friction drop to hold against them; repeatable")
    ] = None,
    force: ForceOpt = False,
) -> None:
    """Write one self-contained HTML page of results: tables, figures, scenes, provenance, what to cite."""
    from chemage.report import write_report

    with terminal.progress_bars() as tell:
        tell("report", 0, 0)
        written = write_report(files, out, measured=measured or (), force=force)
        tell("report", 1, 1)
    print(written)


def _print_comparison(made: Comparison) -> None:
    names, rows = [one.name for one in made.results], made.table()
    for first in range(0, len(names), 4):  # more columns cannot be read
        chosen = slice(first, first + 4)
        table = terminal.table("", ("", *names[chosen]))
        for label, texts in rows:
            table.add_row(label, *texts[chosen])
        terminal.show(table)
    print(made.statement())
    for different in made.chemistry_differences():
        told = ("none" if value is None else f"{value}" for value in different.values)
        print(f"  {different.path}: {' | '.join(told)}")
    fits = made.fits()
    if fits:
        table = terminal.table("Fits, 95 % bootstrap intervals", ("data", "model", "β per decade", "cut-off time"))
        for name, fit in fits:
            table.add_row(name, fit.describe(), fit.beta_text(), fit.cutoff_text())
        terminal.show(table)


@app.command()
def tradeoff(
    scene: SceneArg,
    changes: SetOpt = None,
    out: Annotated[Path | None, typer.Option("--out", "-o", help="figure (png, pdf or svg); default none")] = None,
    as_json: JsonOpt = False,
    force: ForceOpt = False,
) -> None:
    """Measure speed against accuracy on a scene: each knob turned on its own, its cost and its error."""
    from chemage import store
    from chemage.scene import load_scene
    from chemage.text import plus_minus
    from chemage.tradeoff import figure
    from chemage.tradeoff import tradeoff as measure

    one = load_scene(scene, _changes(changes))
    if out is not None:
        store.preflight(out, force=force)
    with terminal.progress_bars() as tell:
        found = measure(one, tell=lambda what: tell(what, 0, 0))
    if out is not None:
        with store.fresh_file(out, force=force) as part:
            figure(found).savefig(part, format=out.suffix.removeprefix(".") or "png")
    if as_json:
        print(json.dumps(found.todict()))
        return
    table = terminal.table(
        f"Speed against accuracy: {one.name} (* as in the scene)",
        ("knob", "setting", "CPU s", "wall s", "A/A0", "area err", "p err", "beta", ""),
    )
    for row in found.rows:
        table.add_row(
            row.knob,
            row.setting + (" *" if row.own else ""),
            _number(row.cpu_seconds),
            _number(row.wall_seconds),
            _number(row.area_fraction, 5),
            _number(row.area_error, 2),
            _number(row.pressure_error, 2),
            plus_minus(row.beta, row.beta_stderr) if row.beta == row.beta else "",
            row.remark,
        )
    terminal.show(table, width=180)


def _number(value: float, digits: int = 3) -> str:
    return f"{value:.{digits}g}" if value == value else ""


# -- schema, init, plugins --------------------------------------------------------------------------------------------


@app.command()
def schema() -> None:
    """Print the JSON Schema of scene files, every installed plugin included."""
    from chemage.schema import scene_schema

    print(json.dumps(scene_schema(), indent=2))


@app.command()
def init(
    file: Annotated[Path, typer.Argument(help="the scene file to write")] = Path("scene.toml"),
    like: Annotated[str, typer.Option("--like", help="installed scene to start from")] = "silica-rough",
    force: ForceOpt = False,
) -> None:
    """Write a commented scene file to start from."""
    from chemage import registry, store
    from chemage.scene import installed_text
    from chemage.spec import nearest

    plugins = registry.current()
    if like not in plugins.scenes():
        names = sorted(plugins.scenes())
        raise _user_error(f"no installed scene {like!r}{nearest(like, names)}; installed: {', '.join(names) or 'none'}")
    text = installed_text(like)
    with store.fresh_file(file, force=force) as part:
        part.write_text(text, encoding="utf-8")
    print(f"{file} is a copy of {like}; change it, then: chemage check {file} && chemage run {file}")


@plugins_app.command("list")
def plugins_list(as_json: JsonOpt = False) -> None:
    """List every installed choice, by role, and where it comes from."""
    from chemage import registry
    from chemage.spec import ROLES

    plugins = registry.current()
    rows = [
        {"role": role, "kind": kind, "from": record.source, "target": record.kinds[role][kind]}
        for role in ROLES
        for kind in plugins.kinds(role)
        for record in plugins.offers(role, kind)
    ]
    broken = [{"plugin": r.name, "from": r.source, "error": r.error} for r in plugins.records if r.error]
    if as_json:
        print(json.dumps({"choices": rows, "scenes": plugins.scenes(), "broken": broken}))
        return
    table = terminal.table("", ("role", "kind", "from"))
    for row in rows:
        table.add_row(row["role"], row["kind"], row["from"])
    for record in plugins.records:
        for name in record.scenes:
            table.add_row("scene", name, record.source)
    terminal.show(table)
    for item in broken:
        print(f"skipped: {item['plugin']} ({item['from']}): {item['error']}")


@plugins_app.command("show")
def plugins_show(
    kind: Annotated[str, typer.Argument(help="a kind, such as fft-bem")],
    role: Annotated[str | None, typer.Option(help="where several roles have this kind")] = None,
    as_json: JsonOpt = False,
) -> None:
    """Explain a choice: what it does, its options with units and defaults, what to cite."""
    from chemage import registry
    from chemage.schema import options_of
    from chemage.spec import ROLES, nearest

    plugins = registry.current()
    roles = [name for name in ROLES if kind in plugins.kinds(name) and role in (None, name)]
    if not roles:
        known = sorted({k for name in ROLES if role in (None, name) for k in plugins.kinds(name)})
        raise _user_error(f"no kind {kind!r}{nearest(kind, known)}; installed: {', '.join(known)}")
    shown = []
    for name in roles:
        cls: Any = plugins.choice(name, kind)
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
        print(f"{one['role']} {one['kind']}  ({one['from']})\n\n{inspect.cleandoc(one['about'])}\n")
        table = terminal.table("", ("option", "unit", "default", "meaning"))
        for option in one["options"]:
            table.add_row(option["name"], option["unit"], option["default"], option["meaning"])
        if one["options"]:
            terminal.show(table)
        for text in one["cite"]:
            print(f"cite: {text}")


@plugins_app.command("new")
def plugins_new(
    name: Annotated[str, typer.Argument(help="the kind it will offer, such as my-barriers")],
    role: Annotated[str, typer.Option(help="surface, contact, barriers, interaction, engine, observable or reader")],
    folder: Annotated[Path, typer.Option("--in", help="where to make the folder chemage-NAME")] = Path(),
) -> None:
    """Make the folder of a new plugin: a small working choice of the role, its entry point, and tests."""
    from chemage.scaffold import new

    files = new(name, role, folder)
    for path in files:
        print(path)
    print(f"\nnow: pip install -e {files[0].parent} && chemage plugins show {name}")


@plugins_app.command("check")
def plugins_check() -> None:
    """Import every registered target and report what is broken; exit status 1 if anything is."""
    from chemage import registry

    plugins = registry.current()
    problems = plugins.check()
    for problem in problems:
        print(problem)
    count = sum(len(kinds) for record in plugins.records for kinds in record.kinds.values())
    print(f"{len(plugins.records)} plugins, {count} choices, {len(problems)} problems")
    if problems:
        raise typer.Exit(1)


# -- shared -----------------------------------------------------------------------------------------------------------


def _user_error(message: str) -> Exception:
    from chemage.errors import InputError

    return InputError(message)


def _add_plugin_commands() -> None:
    """Add the commands of plugins; one that cannot be added is reported and skipped."""
    import warnings

    from chemage import registry

    known = _command_names()
    for hook in registry.current().manager.hook.chemage_cli.get_hookimpls():
        try:
            offered: Any = hook.function()
            for name, function in offered:
                if name in known:
                    if any(function is one.callback for one in app.registered_commands):
                        continue  # a second call in one process
                    raise ValueError(f"there is a command {name!r} already")
                known.add(name)
                trial = typer.Typer()
                trial.command(name)(function)
                typer.main.get_command(trial)  # a signature that typer cannot read shows here
                app.command(name)(function)
        except (Exception, SystemExit) as error:
            if registry.current().strict:
                raise
            warnings.warn(
                f"commands of plugin {hook.plugin_name} were skipped: {type(error).__name__}: {error}",
                registry.PluginWarning,
                stacklevel=2,
            )


def _command_names() -> set[str]:
    return set(typer.main.get_group(app).commands)


def main() -> None:
    """Run the command line; every error of ours is one message on stderr."""
    try:
        for stream in (sys.stdout, sys.stderr):
            if isinstance(stream, io.TextIOWrapper):
                stream.reconfigure(errors="backslashreplace")  # a terminal without µ or Δ
        _plain_warnings()
        _add_plugin_commands()
        commands = typer.main.get_command(app)
        # typer's own main would swallow the KeyboardInterrupt
        with commands.make_context("chemage", sys.argv[1:]) as context:
            commands.invoke(context)
        sys.stdout.flush()
        sys.exit(0)
    except typer.Exit as end:
        sys.exit(end.exit_code)
    except (KeyboardInterrupt, typer.Abort) as stop:
        print(f"\ninterrupted; {str(stop) or 'nothing was written'}", file=sys.stderr, flush=True)
        # worker threads may still be inside a compiled kernel; waiting for them would not help anyone
        os._exit(130)
    except Exception as error:
        sys.exit(_explain(error))


def _plain_warnings() -> None:
    import warnings

    def plain(message: Warning | str, *_: Any, **__: Any) -> None:
        print(f"chemage: warning: {message}", file=sys.stderr)

    warnings.showwarning = plain


def _explain(error: Exception) -> int:
    from chemage.errors import ChemageError

    if isinstance(error, ChemageError):
        print("\n".join([f"chemage: {error}", *getattr(error, "__notes__", ())]), file=sys.stderr)
        return 2
    display = getattr(error, "show", None)  # a usage error of the command line itself
    if display is not None:
        display()
        return int(getattr(error, "exit_code", 2))
    if isinstance(error, BrokenPipeError):  # the reader of a pipe has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    if isinstance(error, OSError):
        print(f"chemage: {error}", file=sys.stderr)
        return 2
    if isinstance(error, MemoryError):
        print(f"chemage: not enough memory: {error}; `chemage check` says what a scene needs", file=sys.stderr)
        return 2
    raise error


if __name__ == "__main__":
    main()
