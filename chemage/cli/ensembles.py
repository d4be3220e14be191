"""Ensembles on the command line."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from chemage.cli import terminal
from chemage.cli.files import drawn, figures_of, preflight_folder, result_written
from chemage.cli.options import user_error
from chemage.foundation import compiling
from chemage.foundation.progress import progress_bars, reported

if TYPE_CHECKING:
    from chemage.scene.scene import Scene


def samples_of(path: Path) -> Path:
    """The folder of the samples of a result file."""
    return path.with_name(f"{path.stem}-samples")


def run(
    scene: Scene,
    path: Path,
    *,
    threads: int | None,
    early: compiling.Helpers,
    figures: bool,
    as_json: bool,
    force: bool,
    executor: str | None = None,
    workers: int | None = None,
    patience: str | None = None,
    points: str | None = None,
) -> None:
    """Sample the ensemble that a scene asks for, write it to ``path`` and print it."""
    from chemage.foundation.files import preflight
    from chemage.foundation.result import result_of
    from chemage.results.files import write
    from chemage.scene.warm_up import compiled_ahead
    from chemage.studies.ensembles.running import CORRECTING, SAMPLING, SKETCHING, Sampler

    folder = samples_of(path)
    preflight(path, force=force)
    if figures:
        preflight_folder(figures_of(path), force)
    if folder.is_symlink() or (folder.exists() and not folder.is_dir()):
        raise user_error(f"{folder}, the folder for the samples, is a file or a link; choose another --out")
    pictures: list[Path] = []
    where = {"executor": executor or ("processes" if (workers or 1) > 1 else "threads"), "workers": workers}
    sampler = Sampler(scene, samples=folder, threads=threads, patience=patience, points=points, **where)
    counted = sampler.request.counted
    with progress_bars({SAMPLING: counted, SKETCHING: counted, CORRECTING: counted}) as report:
        with compiled_ahead(scene, report, threads, early) as told:
            mean = sampler.run(told)
        if not sampler.writes:
            terminal.show_result(result_of(mean))
            return terminal.say(f"the first share writes {path}")
        with reported(report, "writing"):
            write(path, mean, force=force)
        if figures:
            with result_written(path), reported(report, "drawing"):
                pictures = drawn(result_of(mean), path)
    kept = sampler.archive.taken
    taken = [f"{kept} sample{'s' if kept > 1 else ''} taken from {folder}"] if kept else []
    more = "a run with a smaller interval takes these samples up; the folder may be removed otherwise"
    written = {"file": path, "samples": folder, "samples_taken": kept, "figures": pictures}
    terminal.answer(result_of(mean), as_json, [*taken, more], **written)
