"""Checks of an observable."""

from __future__ import annotations

import unicodedata
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np

from chemage.ageing.aging import Aging
from chemage.ageing.observables import Observable, Observed
from chemage.ageing.outputs import Checker, declaration_problems
from chemage.foundation.errors import PluginError
from chemage.lattices.chemistry import Chemistry
from chemage.testing.checks import check_of, require, run_checks, speed_variants
from chemage.testing.replicas import Even, Replica, finished, with_states


def check_observable(component: Observable, *, all: bool = False) -> None:
    """Run every check of the role ``observable``; raises CheckFailed if one fails, with ``all`` every one that does."""
    run_checks(component, Observable, {}, all)


def _numbers(component: Observable, replica: Replica, what: str) -> dict[str, np.ndarray]:
    """What the observable measures, which must be named numbers."""
    try:
        found = component.measure(*(with_states(replica) if component.states else replica))
    except Exception as error:
        raise AssertionError(f"{what}: measure() raised {type(error).__name__}: {error}") from error
    require(isinstance(found, Mapping) and found, f"{what}: measure() returned {found!r}; expected names with numbers")
    require(all(isinstance(name, str) for name in found), f"names {list(found)} are not all str")
    values = {name: np.asarray(value) for name, value in found.items()}
    kinds = {name: value.dtype.kind for name, value in values.items()}
    require(set(kinds.values()) <= set("fiub"), f"{what}: not numbers: {kinds}")
    return values


@check_of("observable")
def _observes_numbers(component: Observable) -> None:
    """Names and shapes are the same for all replicas of a contact, with or without bonds and sites."""
    shapes = {}
    for n, bonded in ((40, 0), (40, 17), (40, 40), (1, 1), (0, 0)):
        values = _numbers(component, finished(n, bonded), f"{bonded} of {n} sites bonded")
        shapes[n, bonded] = {name: value.shape for name, value in values.items()}
        if bonded == 17:
            lost = [name for name, value in values.items() if value.size and not np.isfinite(value).any()]
            require(not lost, f"{', '.join(lost)}: no finite number, although 17 of 40 sites are bonded")
    first = next(iter(shapes.values()))
    for (n, bonded), shape in shapes.items():
        require(shape == first, f"{bonded} of {n} sites bonded: {shape}, expected {first} as for the other replicas")


@check_of("observable")
def _names_are_safe(component: Observable) -> None:
    """Names can be those of a variable in a file and of a column in a table: no slash, no control character, no blank
    at either end."""
    for name in _numbers(component, finished(40, 17), "17 of 40 sites bonded"):
        bad = [character for character in name if character in "/\\" or unicodedata.category(character)[0] == "C"]
        require(not bad, f"the name {name!r} contains {bad[:1]!r}, which a file or a table cannot hold; rename it")
        require(
            name and name == name.strip() and name not in (".", "..") and len(name) <= 100,
            f"the name {name!r} cannot be that of a variable in a file; rename it",
        )


@check_of("observable")
def _measures_what_it_declares(component: Observable) -> None:
    """What is measured are just the ``outputs``, where they are declared: with these dimensions, of which
    ``hold_times`` is as long as the hold times, with safe names, and units that can be read."""
    problems = declaration_problems(component.outputs)
    require(not problems, "; ".join(problems))
    if not component.outputs:
        return
    from chemage.foundation.units import unit_registry as units

    for name, output in component.outputs.items():
        try:
            units().parse_units(output.unit)
        except Exception as error:
            raise AssertionError(f"output {name!r}: the unit {output.unit!r} cannot be read: {error}") from error
        require(output.description.strip(), f"output {name!r} has no description")
    for times in ((0.0, 10.0), (0.0, 0.5, 2.0, 10.0, 10.0), (10.0,)):
        replica = finished(40, 17, times=times)
        checker = Checker("it", len(times))
        found = _numbers(component, replica, f"{len(times)} hold times")
        try:
            checker.names(found, component.outputs)
            for name, values in found.items():
                checker.values(name, values, component.outputs[name])
        except PluginError as error:
            raise AssertionError(f"{len(times)} hold times: {error}") from error


@check_of("observable")
def _parts_may_be_absent(component: Observable) -> None:
    """Lattices without breaking barriers or without interaction, and a single hold time, are measured too."""
    for breaking, interacting in ((False, True), (True, False), (False, False)):
        replica = finished(40, 17, breaking=breaking, interacting=interacting)
        lack = [word for word, there in (("breaking", breaking), ("interaction", interacting)) if not there]
        _numbers(component, replica, f"a lattice without {' and '.join(lack)}")
    for times in ((10.0,), (0.0,), (1.0, 1.0, 10.0)):
        _numbers(component, finished(40, 17, times=times), f"hold times of {', '.join(f'{t:g}' for t in times)} s")


@check_of("observable")
def _grids_need_not_be_square(component: Observable) -> None:
    """Contacts whose grid is not square are measured, with the same names; maps are (nx, ny)."""
    names = set(_numbers(component, finished(40, 17), "an 8x8 grid"))
    for grid in ((13, 5), (5, 13)):
        values = _numbers(component, finished(40, 17, grid=grid), f"a grid of {grid[0]}x{grid[1]} pixels")
        require(set(values) == names, f"a grid of {grid} pixels has other names: {sorted(set(values) ^ names)}")
        swapped = [name for name, value in values.items() if value.shape[-2:] == grid[::-1]]
        require(not swapped, f"a grid of {grid} pixels (nx, ny): {', '.join(swapped)} has the shape {grid[::-1]}")


@check_of("observable")
def _measure_disturbs_nothing(component: Observable) -> None:
    """A replica is measured the same way every time, whatever was measured before or at the same time, and stays as it
    was."""
    replicas = [finished(40, 17), finished(40, 40), finished(30, 5)]
    parts = [array.tobytes() for contact, lattice, history in replicas for array in _arrays(contact, lattice, history)]

    def found(replica: Replica) -> dict[str, bytes]:
        return {name: value.tobytes() for name, value in _numbers(component, replica, "a replica").items()}

    first = [found(replica) for replica in replicas]
    require([found(replica) for replica in replicas] == first, "a second call gave another result")
    with ThreadPoolExecutor(3) as pool:
        require(list(pool.map(found, replicas * 3)) == first * 3, "concurrent calls gave other results")
    after = [array.tobytes() for contact, lattice, history in replicas for array in _arrays(contact, lattice, history)]
    require(after == parts, "measure() changed the contact, the lattice or the history")


def _arrays(*records: Any) -> list[np.ndarray]:
    return [value for record in records for value in record.todict().values() if isinstance(value, np.ndarray)]


def _aging(component: Observable, replicas: Sequence[Replica]) -> Aging:
    """The result of these replicas, as ``chemage.age`` makes it."""
    measured = [_numbers(component, replica, "a replica") for replica in replicas]
    first = replicas[0]
    return Aging(
        hold_times=first.history.hold_times,
        bonds=np.stack([replica.history.bonds for replica in replicas]),
        sites=np.array([replica.lattice.sites.size for replica in replicas]),
        events=np.array([replica.history.events for replica in replicas]),
        load=first.contact.load,
        temperature=300.0,
        engine="by-hand",
        contact=first.contact.summary(),
        observables={name: np.stack([values[name] for values in measured]) for name in measured[0]},
        provenance={"observe": [component.todict()]},
    )


@check_of("observable")
def _figures_are_drawn(component: Observable) -> None:
    """Each of ``figures`` has a caption and is drawn from all replicas, of one result and of several, also where the
    chemistry is not known."""
    figures = type(component).figures
    require(isinstance(figures, Mapping), f"figures = {figures!r}; give a mapping from names to captions")
    if not figures:
        return
    few, many, some = finished(40, 3), finished(40, 40), finished(40, 17)
    one, other = _aging(component, [some, few, few]), _aging(component, [some, many, many])
    chemistry = Chemistry(forming=Even(), activation_volume=0.04)
    same = all(np.array_equal(one.observables[name], other.observables[name]) for name in one.observables)
    for figure, caption in figures.items():
        require(isinstance(figure, str) and figure, f"figures names {figure!r}; give names as str")
        require(isinstance(caption, str) and caption.strip(), f"figure {figure!r} has no caption")
        first = _drawn(component, figure, [Observed("one", one, chemistry, "#0072b2")])
        _drawn(component, figure, [Observed("one", one, None, "#0072b2")])
        _drawn(component, figure, [Observed("one", one, chemistry, "C0"), Observed("two", other, None, "C1")])
        second = _drawn(component, figure, [Observed("one", other, chemistry, "#0072b2")])
        require(
            same or first != second,
            f"figure {figure!r} is the same whatever the second and the third replica have; draw all replicas",
        )


def _drawn(component: Observable, figure: str, results: Sequence[Observed]) -> bytes:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    canvas = FigureCanvasAgg(Figure())
    axes = canvas.figure.subplots()
    component.draw(figure, axes, results)
    require(axes.has_data(), f"draw({figure!r}) of {len(results)} result(s) left the axes empty")
    canvas.draw()
    return bytes(canvas.buffer_rgba())


@check_of("observable")
def _speed_does_not_change_the_numbers(component: Observable) -> None:
    """Options in ``speed_only`` do not change a bit of what is measured."""
    replica = finished(40, 17)
    plain = {name: value.tobytes() for name, value in _numbers(component, replica, "a replica").items()}
    for what, variant in speed_variants(component):
        found = {name: value.tobytes() for name, value in _numbers(variant, replica, what).items()}
        require(found == plain, f"{what}: the numbers differ, but speed_only says that they do not")
