"""What a scene needs and what it will cost, estimated before anything is computed."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from chemage.experiments.cost import Cost
from chemage.experiments.limits import check_limits, check_parts, duration, long_run
from chemage.experiments.scene import Scene
from chemage.foundation.calls import call_with
from chemage.foundation.errors import ChemageError
from chemage.foundation.threads import available
from chemage.foundation.units import EV_PER_GPA_NM3, KB
from chemage.lattices.expected import expected_events
from chemage.lattices.site_grid import in_words


@dataclass(frozen=True)
class Plan:
    """Estimates of what a scene needs; what no component states is absent."""

    scene: Scene
    #: what is modelled and what is not, in words
    stages: dict[str, str]
    #: nx, ny, area_fraction, sites, cpu_seconds, seconds (wall time), memory (bytes), file (bytes)
    numbers: dict[str, float]
    notes: list[str] = field(default_factory=list)

    def todict(self) -> dict[str, Any]:
        """One JSON-able object."""
        return {
            "name": self.scene.name,
            "stages": self.stages,
            "notes": self.notes,
            "keys": self.scene.keys(),
            **self.numbers,
        }

    def rows(self) -> list[tuple[str, str]]:
        """(name, text) lines for a table."""
        known = self.numbers
        rows = list(self.stages.items())
        if "area_fraction" in known:
            rows.append(("expected area fraction", f"{known['area_fraction']:.3g}"))
        if "sites" in known:
            rows.append(("expected sites", f"{known['sites']:.3g} in contact per replica"))
        if "cpu_seconds" in known:
            rows.append(("expected cost", f"about {known['cpu_seconds']:.2g} CPU seconds once kernels are compiled"))
        if "memory" in known:
            rows.append(("expected memory", f"about {known['memory'] / 1e9:.2g} GB"))
        if "file" in known:
            rows.append(("result file", f"about {known['file'] / 1e6:.3g} MB"))
        return rows


def cost(scene: Scene) -> Cost:
    """The one estimate of what ``scene`` costs, from what its components state; single scenes and sweeps use it.

    Raises
    ------
    ChemageError
        A surface file cannot be read.
    """
    with scene.in_use():
        return _cost(scene)


def _cost(scene: Scene) -> Cost:
    try:
        surface: dict[str, float] = dict(scene.surface.expected())
    except ChemageError as error:
        error.add_note(f"in [surface] of scene {scene.name!r}")
        raise
    solve = scene.solver.expected(surface, scene.load)
    gap = solve.get("gap_bytes", 0.0)
    fraction, sites, replica = solve.get("area_fraction"), None, {}
    pixels = surface.get("nx", 0.0) * surface.get("ny", 0.0)
    if fraction is not None and pixels:
        grids = scene.site_grids
        count = grids[1][0] * grids[1][1] if grids else pixels
        sites = fraction * count * (scene.chemistry.hydroxylation if scene.chemistry else 1.0)
    reacting = scene.engine is not None and scene.hold is not None
    if scene.engine is not None and scene.chemistry is not None and sites is not None:
        coupled = scene.chemistry.interaction is not None
        replica = call_with(scene.engine.expected, sites, coupled, events=_events(scene, surface, fraction))
    seconds = replica.get("cpu_seconds") if reacting else 0.0
    replica_bytes = replica.get("bytes") if reacting else 0.0
    if replica_bytes is not None and sites is not None and scene.hold is not None and scene.keeps_states:
        replica_bytes += sites * scene.hold.hold_times.size
    return Cost(
        surface,
        fraction,
        sites,
        solve.get("cpu_seconds"),
        None if seconds is None else seconds * (scene.hold.replicas if scene.hold else 1),
        solve.get("bytes"),
        replica_bytes,
        gap,
        12 * pixels * (1.0 if fraction is None else fraction) + gap,
    )


def _events(scene: Scene, surface: Mapping[str, float], fraction: float | None) -> float | None:
    """Events per site that a replica is expected to have, as far as it is known."""
    area = surface.get("nx", 0.0) * surface.get("ny", 0.0) * surface.get("pixel_size", 0.0) ** 2 * (fraction or 0.0)
    if scene.chemistry is None or scene.hold is None or not area > 0:
        return None
    return expected_events(scene.chemistry, scene.load / area, float(scene.hold.hold_times[-1]), scene.hold.temperature)


def plan(scene: Scene) -> Plan:
    """Estimate what ``scene`` needs from what its components state.

    Raises
    ------
    InputError
        It needs more memory than this machine has, or its parts do not fit together.
    """
    known = cost(scene)
    check_limits(scene, known)
    check_parts(scene, known)
    numbers: dict[str, float] = {}
    if known.pixels:
        # heights are noise and do not compress; a pressure map is as large as what carries pressure
        carrying = 1.0 if known.area_fraction is None else min(1.0, 2 * known.area_fraction)
        stored = (8 + 8 * carrying) * known.pixels + known.gap_bytes
        numbers |= {"nx": known.surface["nx"], "ny": known.surface["ny"], "file": stored}
        if known.area_fraction is not None:
            numbers["area_fraction"] = known.area_fraction
        if known.sites is not None:
            numbers["sites"] = known.sites
    if known.contact_cpu_seconds is not None and known.kinetics_cpu_seconds is not None:
        numbers["cpu_seconds"] = known.contact_cpu_seconds + known.kinetics_cpu_seconds
    if known.contact_bytes is not None and known.replica_bytes is not None:
        at_once = min(scene.hold.replicas, available()) if scene.hold is not None else 1
        numbers["memory"] = 2e8 + max(known.contact_bytes, known.replica_bytes * at_once)
    if (seconds := duration(scene, known)) is not None:
        numbers["seconds"] = seconds
    notes = [note for note in [long_run(scene, known)] if note]
    return Plan(scene, _stages(scene, known.surface), numbers, notes + _notes(scene, known.surface, numbers))


def _stages(scene: Scene, known: Mapping[str, float]) -> dict[str, str]:
    grid = f", {known['nx']:.0f} x {known['ny']:.0f} pixels" if "nx" in known and "ny" in known else ""
    stages = {
        "surface": f"{scene.surface.kind}{grid}, seed {scene.surface_seed}",
        "contact": f"{scene.contact.kind} at {scene.load:g} nN",
    }
    chemistry, hold, engine = scene.chemistry, scene.hold, scene.engine
    if chemistry is None or hold is None or engine is None:
        stages["chemistry"] = "not modelled: contact mechanics only"
        return stages
    stages["forming"] = chemistry.forming.kind + (
        f", lowered by {chemistry.activation_volume * EV_PER_GPA_NM3:.3g} eV/GPa"
        if chemistry.activation_volume
        else ", pressure only decides who is in contact"
    )
    stages["breaking"] = chemistry.breaking.kind if chemistry.breaking else "not modelled: bonds last"
    stages["interaction"] = chemistry.interaction.kind if chemistry.interaction else "not modelled: no neighbour list"
    if grids := scene.site_grids:
        gap = getattr(scene.solver, "gap", False) is True
        stages["sites"] = in_words(*grids, gap=gap)
    times = hold.hold_times
    stages["kinetics"] = (
        f"{engine.kind}, {hold.temperature:g} K, {times.size} hold times from {times[0]:g} to {times[-1]:g} s, "
        f"{hold.replicas} replicas, seed {hold.seed}"
    )
    mean = f"mean force of {chemistry.bond_force:g} nN per bond, front factor {chemistry.front_factor:g}"
    stages["rupture"] = scene.rupture.kind if scene.rupture is not None else mean
    return stages


def _notes(scene: Scene, known: Mapping[str, float], numbers: dict[str, float]) -> list[str]:
    notes = []
    if scene.load == 0:
        notes.append("the load is 0: nothing touches, the friction drop is 0 and its coefficient undefined")
    wave, pixel = known.get("shortest_wavelength"), known.get("pixel_size")
    if wave and pixel and wave < 8 * pixel:
        notes.append(
            f"the shortest wavelength is {wave / pixel:.1f} pixels; pixel-scale errors of the contact area and "
            "pressure grow below about 8, compare with more pixels at the same size"
        )
    if numbers.get("sites", math.inf) < 100:
        notes.append(
            f"only about {numbers['sites']:.0f} sites will be in contact; averages need many replicas or seeds"
        )
    if numbers.get("area_fraction", 0.0) > 0.95:
        notes.append("the contact is expected to be nearly full")
    hold = scene.hold
    if hold is not None and scene.chemistry is not None:
        times = hold.hold_times
        inside = (times >= scene.fit.start * (1 - 1e-9)) & (times <= scene.fit.stop * (1 + 1e-9))
        if np.count_nonzero(inside) < 3:
            notes.append(
                f"only {np.count_nonzero(inside)} hold times lie in the fit window; beta will be poor or absent"
            )
        nu = scene.chemistry.attempt_frequency
        lowest, highest = scene.chemistry.forming.quantile(np.array([0.05, 0.95]))
        active = KB * hold.temperature * np.log(max(nu * times[-1], 1.0))
        if active < lowest:
            notes.append(
                f"by {times[-1]:g} s only barriers up to {active:.2f} eV react, below 95 % of the forming barriers"
            )
        elif KB * hold.temperature * np.log(max(nu * max(times[0], 1e-300), 1.0)) > highest:
            notes.append(f"at {times[0]:g} s nearly every forming barrier is already crossed; start earlier")
    return notes
