"""What a scene needs and what it will cost, estimated before anything is computed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from chemage.ageing.kinetics import EVERY_SITE
from chemage.contacts.options import force_text, modulus_in, pressure_text
from chemage.contacts.role import ContactTheory
from chemage.foundation.components import call_with
from chemage.foundation.errors import ChemageError
from chemage.foundation.machine import slowness
from chemage.foundation.threads import available
from chemage.foundation.units import EV_PER_GPA_NM3
from chemage.lattices.independent import Expected, expected_kinetics, rough_pressures, smooth_pressures
from chemage.lattices.site_grid import in_words, nominal_ratio
from chemage.scene.cost import Cost
from chemage.scene.doubts import doubts
from chemage.scene.limits import check_limits, duration, in_hours
from chemage.scene.scene import Scene

#: CPU seconds of a replica beside its engine, and for each of its sites (half of it where none interacts), and of each
#: pixel beside surface and solver: measured on a 2-core Intel Xeon machine (``tests/benchmarks/estimates.py``)
REPLICA_SECONDS, SITE_SECONDS, PIXEL_SECONDS = 2.5e-3, 1e-6, 2e-8
#: a time below this is stated as less than a second, s
SHORT = 0.5
_SECONDS = ("cpu_seconds", "cpu_seconds_least", "cpu_seconds_most")


@dataclass(frozen=True)
class Plan:
    """Estimates of what a scene needs; what no component states is absent."""

    scene: Scene
    #: what is modelled and what is not, in words
    stages: dict[str, str]
    #: nx, ny, area_fraction, sites, cpu_seconds, seconds (wall time), memory (bytes), file (bytes)
    numbers: dict[str, float]
    #: what to know before it runs, in words; :func:`chemage.run` emits each as a ``PlanWarning``
    notes: list[str] = field(default_factory=list)
    #: why the time is a range, where it is one
    range_reason: str = ""

    @property
    def seconds_range(self) -> tuple[float, float] | None:
        """Least and most CPU seconds, where no single number can be given."""
        names = ("cpu_seconds_least", "cpu_seconds_most")
        return (self.numbers[names[0]], self.numbers[names[1]]) if names[1] in self.numbers else None

    def seconds_text(self) -> str:
        """The CPU time in words; "" where it is not known."""
        once = "once kernels are compiled"
        if self.seconds_range and self.seconds_range[1] > SHORT:
            least, most = (_time(value) for value in self.seconds_range)
            return f"{least} to {most} of CPU time {once}: {self.range_reason}"
        seconds = self.numbers.get("cpu_seconds")
        if seconds is None:
            return ""
        return (
            f"less than a second of CPU time {once}"
            if seconds < SHORT
            else f"about {_time(seconds)} of CPU time {once}"
        )

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
        if "events" in known:
            rows.append(("expected events", f"about {known['events']:.2g} bonds formed and broken per site"))
        if text := self.seconds_text():
            rows.append(("expected cost", text))
        if text and "machine_speed" in known:
            rows.append(("speed of this machine", f"{known['machine_speed']:.2g} times the reference, measured once"))
        if "memory" in known:
            rows.append(("expected memory", f"about {known['memory'] / 1e9:.2g} GB"))
        if "file" in known:
            rows.append(("result file", f"about {known['file'] / 1e6:.3g} MB"))
        return rows


def _time(seconds: float) -> str:
    return in_hours(seconds) if seconds >= 120 else f"{seconds:.0f} s" if seconds >= 10 else f"{seconds:.2g} s"


def cost(scene: Scene, *, here: bool = True) -> Cost:
    """The one estimate of what ``scene`` costs, from what its components state; single scenes and sweeps use it.

    Seconds are those of this machine (:func:`chemage.foundation.machine.slowness`), or with ``here`` False those of
    the machine on which components were calibrated.

    Raises
    ------
    ChemageError
        A surface file cannot be read.
    """
    with scene.in_use():
        found, factor = _cost(scene), slowness() if here else 1.0
    contact, kinetics, both = found.contact_cpu_seconds, found.kinetics_cpu_seconds, found.kinetics_range
    return replace(
        found,
        contact_cpu_seconds=None if contact is None else contact * factor,
        kinetics_cpu_seconds=None if kinetics is None else kinetics * factor,
        kinetics_range=None if both is None else (both[0] * factor, both[1] * factor),
    )


def _cost(scene: Scene) -> Cost:
    try:
        surface: dict[str, float] = dict(scene.surface.expected())
    except ChemageError as error:
        error.add_note(f"in [surface] of scene {scene.name!r}")
        raise
    solve = scene.solver.expected(surface, scene.load)
    if isinstance(scene.contact, ContactTheory):
        return _without_map(scene, surface, solve)
    gap = solve.get("gap_bytes", 0.0)
    fraction, sites = solve.get("area_fraction"), None
    pixels = surface.get("nx", 0.0) * surface.get("ny", 0.0)
    if fraction is not None and pixels:
        grids = scene.site_grids
        count = grids[1][0] * grids[1][1] if grids else pixels
        sites = fraction * count * (scene.chemistry.hydroxylation if scene.chemistry else 1.0)
    pressure = _mean_pressure(scene, surface, fraction)
    expected = _expected(scene, surface, pressure)
    kinetics = _kinetics(scene, sites, expected)
    contact_seconds = solve.get("cpu_seconds")
    if contact_seconds is not None:
        contact_seconds += surface.get("cpu_seconds", 0.0) + PIXEL_SECONDS * pixels
    return Cost(
        surface,
        fraction,
        sites,
        contact_seconds,
        kinetics.get("cpu_seconds"),
        solve.get("bytes"),
        kinetics.get("bytes"),
        gap,
        12 * pixels * (1.0 if fraction is None else fraction) + gap,
        *_range(kinetics, scene),
        events=None if expected is None else expected.events,
        bonded=None if expected is None else expected.bonded,
        mean_pressure=pressure,
    )


def _kinetics(scene: Scene, sites: float | None, expected: Expected | None) -> dict[str, float]:
    """``cpu_seconds`` of all replicas, with ``_least`` and ``_most`` where it is a range, and ``bytes`` of one."""
    hold, chemistry, engine = scene.hold, scene.chemistry, scene.engine
    if hold is None or engine is None or chemistry is None:
        return {"cpu_seconds": 0.0, "bytes": 0.0}
    if sites is None:
        return {}
    coupled = chemistry.interaction is not None
    events = None if expected is None else expected.events
    replica = dict(call_with(engine.expected, sites, coupled, events=events))
    seconds = [name for name in _SECONDS if name in replica]
    for name in seconds:
        replica[name] += REPLICA_SECONDS + (SITE_SECONDS if coupled else SITE_SECONDS / 2) * sites
    if scene.ageing is not None:
        found = dict(call_with(scene.ageing.expected, sites, replica, hold.replicas, interacting=coupled))
    else:
        found = replica | {name: replica[name] * hold.replicas for name in seconds}
    if "bytes" in found and scene.keeps_states:
        found["bytes"] += sites * hold.hold_times.size
    return found


def _range(kinetics: Mapping[str, float], scene: Scene) -> tuple[tuple[float, float] | None, str]:
    """Least and most CPU seconds of the kinetics, where they are no single number, and why."""
    if not {"cpu_seconds_least", "cpu_seconds_most"} <= kinetics.keys():
        return None, ""
    by = f"ageing {scene.ageing.kind!r}" if scene.ageing is not None else ""
    by = by or (f"engine {scene.engine.kind!r}" if scene.engine is not None else "")
    return (
        kinetics["cpu_seconds_least"],
        kinetics["cpu_seconds_most"],
    ), f"the cost of {by} depends on what happens during the run"


def _without_map(scene: Scene, surface: Mapping[str, float], solve: Mapping[str, float]) -> Cost:
    """The cost of a contact of which there is no map, and so no pixels."""
    fraction, sites = solve.get("area_fraction"), None
    area = surface.get("nx", 0.0) * surface.get("ny", 0.0) * surface.get("pixel_size", 0.0) ** 2
    chemistry, found = scene.chemistry, {"cpu_seconds": 0.0, "bytes": 0.0}
    if chemistry is not None and not isinstance(chemistry.site_density, str) and fraction is not None:
        sites = fraction * area * chemistry.site_density * chemistry.hydroxylation
    if scene.ages and scene.ageing is not None and scene.hold is not None:
        coupled = chemistry is not None and chemistry.interaction is not None
        # there is no site in memory
        found = call_with(scene.ageing.expected, 0.0, {}, scene.hold.replicas, interacting=coupled)
    known = {name: value for name, value in surface.items() if name not in ("nx", "ny", "pixel_size")}
    known["nominal_area"] = area
    pressure = _mean_pressure(scene, surface, fraction)
    expected = _expected(scene, surface, pressure)
    return Cost(
        known,
        fraction,
        sites,
        solve.get("cpu_seconds"),
        found.get("cpu_seconds"),
        solve.get("bytes"),
        found.get("bytes"),
        0,
        0,
        *_range(found, scene),
        events=None if expected is None else expected.events,
        bonded=None if expected is None else expected.bonded,
        mean_pressure=pressure,
    )


def _mean_pressure(scene: Scene, surface: Mapping[str, float], fraction: float | None) -> float | None:
    """Mean pressure in contact, GPa, as far as it is known."""
    area = surface.get("nx", 0.0) * surface.get("ny", 0.0) * surface.get("pixel_size", 0.0) ** 2 * (fraction or 0.0)
    return scene.load / area if area > 0 else None


def _expected(scene: Scene, surface: Mapping[str, float], pressure: float | None) -> Expected | None:
    """Events and bonds per site of a replica, as far as they are known."""
    if scene.chemistry is None or scene.hold is None or pressure is None:
        return None
    spread = smooth_pressures if "radius" in surface else rough_pressures
    last = float(scene.hold.hold_times[-1])
    return expected_kinetics(scene.chemistry, spread(pressure), last, scene.hold.temperature)


def plan(scene: Scene) -> Plan:
    """Estimate what ``scene`` needs from what its components state.

    Raises
    ------
    InputError
        It needs more memory than this machine has, or its parts do not fit together.
    """
    known = cost(scene)
    check_limits(scene, known)
    found = doubts(scene, known)
    numbers: dict[str, float] = {}
    if known.pixels:
        # heights are noise and do not compress; a pressure map is as large as what carries pressure
        carrying = 1.0 if known.area_fraction is None else min(1.0, 2 * known.area_fraction)
        stored = (8 + 8 * carrying) * known.pixels + known.gap_bytes
        numbers |= {"nx": known.surface["nx"], "ny": known.surface["ny"], "file": stored}
    if known.pixels or isinstance(scene.contact, ContactTheory):
        if known.sites is not None:
            numbers["sites"] = known.sites
        if known.area_fraction is not None:
            numbers["area_fraction"] = known.area_fraction
    if known.contact_cpu_seconds is not None and known.kinetics_cpu_seconds is not None:
        numbers["cpu_seconds"] = known.contact_cpu_seconds + known.kinetics_cpu_seconds
    if known.contact_bytes is not None and known.replica_bytes is not None:
        at_once = min(scene.hold.replicas, available()) if scene.hold is not None else 1
        numbers["memory"] = 2e8 + max(known.contact_bytes, known.replica_bytes * at_once)
    if (seconds := duration(scene, known)) is not None:
        numbers |= {"seconds": seconds, "machine_speed": 1 / slowness()}
    seconds_range = None
    if known.contact_cpu_seconds is not None and known.kinetics_range is not None:
        least, most = known.kinetics_range
        seconds_range = (known.contact_cpu_seconds + least, known.contact_cpu_seconds + most)
    if seconds_range is not None:
        numbers |= {"cpu_seconds_least": seconds_range[0], "cpu_seconds_most": seconds_range[1]}
    if known.events is not None:
        numbers["events"] = known.events
    return Plan(scene, _stages(scene, known.surface), numbers, [doubt.text for doubt in found], known.range_reason)


def _stages(scene: Scene, known: Mapping[str, float]) -> dict[str, str]:
    grid = f", {known['nx']:.0f} x {known['ny']:.0f} pixels" if "nx" in known and "ny" in known else ""
    stages = {
        "surface": f"{scene.surface.kind}{grid}, seed {scene.surface_seed}",
        "contact": _contact(scene, known),
    }
    if scene.material:
        values = ", ".join(f"{one.path} = {one.text}" for one in scene.from_material)
        stages["material"] = f"{scene.material}: {values or 'the scene gives every value itself'}"
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
        ratio = nominal_ratio(known["pixel_size"], chemistry.site_density)
        stages["sites"] = in_words(*grids, gap=gap, ratio=ratio)
    times, method = hold.hold_times, scene.ageing
    replicas = f", {hold.replicas} replicas, seed {hold.seed}" if (method or EVERY_SITE).replicates else ""
    stages["kinetics"] = (
        f"{engine.kind}, {hold.temperature:g} K, {times.size} hold times from {times[0]:g} to {times[-1]:g} s{replicas}"
    )
    if method is not None:
        means = "" if method.replicates else ": the mean over replicas alone"
        stages["ageing"] = f"{method.kind}, instead of the kinetics of every site{means}"
    mean = f"mean force of {chemistry.bond_force:g} nN per bond, front factor {chemistry.front_factor:g}"
    stages["rupture"] = scene.rupture.kind if scene.rupture is not None else mean
    return stages


def _contact(scene: Scene, known: Mapping[str, float]) -> str:
    """Kind, load, nominal pressure where there is one, and contact modulus, in words."""
    text = f"{scene.contact.kind} at {force_text(scene.load)}"
    area = known.get("nx", 0.0) * known.get("ny", 0.0) * known.get("pixel_size", 0.0) ** 2
    area = known.get("nominal_area", area)
    if area > 0 and scene.contact.is_nominally_flat(known.get("periodic", 1.0) != 0):
        text += f", nominal pressure {pressure_text(scene.load / area)}"
    if (modulus := modulus_in(scene.contact)) is not None:
        text += f", E* {modulus:.6g} GPa"
    theory = ", a theory: statistics and no map" if isinstance(scene.contact, ContactTheory) else ""
    return text + theory
