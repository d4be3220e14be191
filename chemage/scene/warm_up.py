"""Compile the kernels of a scene before they are needed: by command, or in a second process during the first run."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from subprocess import TimeoutExpired
from typing import Any

import numpy as np

from chemage.contacts.role import ContactTheory
from chemage.contacts.solution import ContactSolution
from chemage.foundation import compiling
from chemage.foundation.progress import Report
from chemage.kinetics.role import Engine
from chemage.lattices.stage import build_lattice
from chemage.scene.scene import Scene, parse_scene
from chemage.scene.scene_files import load_scene

#: pixels along the sides of the small contact, of which a quarter is in contact, and of its sites at least
PIXELS, SITES = 4, 12
#: of that contact where the surface does not say it, nm
PIXEL_SIZE = 0.45


def warm_up_ageing(scene: Scene) -> None:
    """Compile what lattice and kinetics of ``scene`` need, on a contact of a few pixels."""
    if not scene.ages or isinstance(scene.contact, ContactTheory):
        return
    assert scene.chemistry is not None
    assert scene.hold is not None
    assert isinstance(scene.engine, Engine)
    with scene.in_use():
        lattice = build_lattice(scene.chemistry, _small_contact(scene))
        scene.engine.warm_up(lattice, scene.hold.temperature)


def warm_up_contact(scene: Scene) -> None:
    """Compile what the contact of ``scene`` needs; what comes last in a solve comes first here."""
    if not isinstance(scene.contact, ContactTheory):
        scene.solver.warm_up(scene.surface.expected(), scene.load)


def warm_up(scene: Scene) -> None:
    """Compile what a run of ``scene`` needs, without computing anything of it."""
    warm_up_contact(scene)
    warm_up_ageing(scene)


def form(scene: Scene) -> str:
    """What kernels may depend on: the scene without the sizes of its numbers. Scenes of one form share their kernels,
    up to those that depend on a number of pixels."""
    data = scene.todict() | {"name": "", "title": ""}
    return json.dumps(_without_numbers(data), sort_keys=True) + str(scene.surface.expected().get("nx", ""))


def _without_numbers(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {name: _without_numbers(item) for name, item in value.items()}
    if isinstance(value, list):
        return [_without_numbers(item) for item in value]
    return type(value).__name__ if isinstance(value, int | float) and not isinstance(value, bool) else value


def _small_contact(scene: Scene) -> ContactSolution:
    """A contact like that of ``scene`` on a few pixels of the same size, under 1 GPa."""
    known: Mapping[str, float] = scene.surface.expected()
    pixel = known.get("pixel_size", PIXEL_SIZE)
    density = scene.chemistry.site_density if scene.chemistry is not None else "pixel"
    n = PIXELS if isinstance(density, str) else max(PIXELS, round(SITES / (pixel * density**0.5)))
    pressure = np.zeros((n, n))
    pressure[n // 4 : n // 4 + n // 2, n // 4 : n // 4 + n // 2] = 1.0
    return ContactSolution(
        pressure=pressure,
        gap=np.where(pressure > 0, 0.0, pixel) if getattr(scene.solver, "gap", False) else None,
        load=float(pressure.sum()) * pixel**2,
        pixel_size=pixel,
        modulus=getattr(scene.contact, "modulus", 1.0),
        periodic=bool(known.get("periodic", 1)),
    )


@contextmanager
def compiled_ahead(
    scene: Scene, report: Report, threads: int | None = None, early: compiling.Helpers | None = None
) -> Iterator[Report]:
    """Report the kernels that are compiled during a block, and compile in other processes what it will need later.

    The block is given the function to report the stages of the run with. The processes are started when the first
    kernel is compiled before the ageing, unless there are ``early`` ones, so that nothing happens where all kernels are
    cached. They share the cache on disk with this process and end with the block; the ageing waits for the one that
    compiles the same, for a minute at most. What becomes of them does not matter otherwise.
    """
    helpers: compiling.Helpers = {}
    stages: set[str] = set()
    count = 0

    def follow(stage: str, done: int, total: int, note: str = "") -> None:
        if stage == "ageing" and stage not in stages:
            _wait({**(early or {}), **helpers}.get(stage), report, count)
        stages.add(stage)
        report(stage, done, total, note)

    def begin(compiled: int) -> None:
        report(compiling.STAGE, compiled, 0, compiling.NOTE)
        if compiled == 0 and not early and "ageing" not in stages:
            helpers.update(compiling.begin(scene.todict(), None, threads))

    def end(compiled: int) -> None:
        nonlocal count
        count = compiled
        report(compiling.STAGE, compiled, 0)

    try:
        with compiling.watched(begin, end):
            yield follow
    finally:
        compiling.end(helpers.values())


def _wait(helper: compiling.Process | None, report: Report, compiled: int) -> None:
    """Wait for a process that has begun to compile what is needed now."""
    if helper is None or helper.poll() is not None:
        return
    report(compiling.STAGE, compiled, 0, compiling.NOTE)
    with suppress(TimeoutExpired):
        helper.wait(compiling.PATIENCE)
    report(compiling.STAGE, compiled, 0)


def compile_stage(stage: str, scene: Mapping[str, Any] | str, changes: Mapping[str, Any] | None) -> None:
    """Compile the kernels of a stage of a scene, given as data, or by name with ``changes``."""
    one = load_scene(scene, changes) if isinstance(scene, str) else parse_scene(scene)
    {"ageing": warm_up_ageing, "contact": warm_up_contact}[stage](one)
