"""What a scene needs, will cost, and what is doubtful about it: one plan, made before anything is computed.

Every stage states what it knows (:meth:`Stage.estimate`); the plan adds it up, holds it against what this machine has,
and collects what to warn of.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from chemage.ageing.age import kept_bytes
from chemage.ageing.methods import check_method, expected_cost
from chemage.foundation.components import Component
from chemage.foundation.errors import ChemageError, InputError, PlanWarning
from chemage.foundation.machine import slowness
from chemage.foundation.memory import require
from chemage.foundation.threads import available
from chemage.foundation.units import units_of
from chemage.lattices.site_grid import BYTES_PER_SITE
from chemage.plugins import registry
from chemage.plugins.hooks import KEYS, Doubt, Parts, Stated
from chemage.plugins.sources import nested
from chemage.scene.scene import Scene

#: resident memory of Python with the libraries that a run uses, and of what it writes, bytes
LIBRARY_BYTES = 2.4e8
#: the same while figures are drawn
DRAWING_BYTES = 3.1e8
#: runs that take longer than this say so first, s
LONG = 3600.0
#: a time below this is stated as less than a second, s
SHORT = 0.5
#: heights and pressure, which stay while the contact ages, for each pixel
MAP_BYTES = 16.0
#: heights, their transform, and the pressure: what any solver has in memory for each pixel at least
BYTES_PER_PIXEL = 24.0
#: sizes that quantities have, whatever the option is called: unit -> (least, most, what they are, a remedy); 0 is fine
USUAL: dict[str, tuple[float, float, str, str]] = {
    "nm": (
        1e-3,
        1e9,
        "lengths in contacts are between picometres and a metre",
        'such as "0.45 nm" or "10 um"',
    ),
    "GPa": (
        1e-9,
        2000.0,
        "moduli and strengths of solids are between 1 Pa and 2000 GPa",
        'such as "35.3 GPa"',
    ),
    "Hz": (
        1e8,
        1e16,
        "attempt frequencies are those of atoms, 1e12 to 1e14 Hz",
        'such as "10 THz"',
    ),
    "nm**3": (
        0.0,
        1.0,
        "activation volumes are a few atoms, 0.001 to 0.1 nm³",
        'such as "6.4 angstrom**3"',
    ),
    "eV": (0.0, 20.0, "barriers of bonds are 0.1 to 5 eV", 'such as "0.8 eV"'),
    "1/nm**2": (
        1e-6,
        100.0,
        "surfaces have some sites per nm²",
        'such as "4.9 /nm**2"',
    ),
}
#: the same of forces in the options of a chemistry, which are those of one bond
BOND_FORCES = (1e-3, 100.0, "bonds break at some nN", 'such as "3 nN"')
#: what a surface states of a map of the contact, which a theory does not make
_MAP = ("nx", "ny", "pixel_size")


class LongRunWarning(PlanWarning):
    """A run will take hours."""


def _stated(section: str, name: str, otherwise: float | None = None) -> property:
    """A number that the stage of a section states; ``otherwise`` where it does not."""

    def number(plan: Plan) -> float | None:
        return plan.stated.get(section, {}).get(name, otherwise)

    return property(number)


@dataclass(frozen=True)
class Plan:
    """Estimates of what a scene needs; what no component states is None, or absent."""

    scene: Scene
    #: :attr:`Scene.solved_parts`
    parts: Parts
    #: section -> what its stage states beforehand, seconds on the machine on which components were calibrated
    stated: Stated
    #: how much slower this machine is
    slowness: float = 1.0

    # -- what is stated of it ------------------------------------------------------------------------------------------

    @property
    def surface(self) -> Mapping[str, float]:
        """What the maker of the surface states: nx, ny, pixel_size, rms_slope, ..."""
        return self.stated["surface"]

    #: number of pixels; 0 where it is not stated, and for a contact without a map
    pixels = _stated("contact", "pixels", 0.0)
    #: expected contact area over the nominal area
    area_fraction = _stated("contact", "area_fraction")
    #: expected mean of the pressure in contact, GPa
    mean_pressure = _stated("contact", "mean_pressure")
    #: bonds formed and broken per site of a replica
    events = _stated("chemistry", "events")
    #: peak memory of the contact, and of one replica, bytes
    contact_bytes = _stated("contact", "bytes")
    replica_bytes = _stated("ageing", "bytes")
    #: of the gap, if the contact has one, and of the rupture law for all replicas, bytes
    gap_bytes = _stated("contact", "gap_bytes", 0.0)
    rupture_bytes = _stated("rupture", "bytes", 0.0)

    @property
    def sites(self) -> float | None:
        """Expected reactive sites in contact; without a chemistry, pixels."""
        if "chemistry" in self.stated:
            return self.stated["chemistry"].get("sites")
        return (
            self.area_fraction * self.pixels
            if self.area_fraction is not None and self.pixels
            else None
        )

    @property
    def contact_file(self) -> float:
        """Bytes of the contact as a sweep stores it."""
        fraction = 1.0 if self.area_fraction is None else self.area_fraction
        return 12 * self.pixels * fraction + (
            self.gap_bytes if self.has_map else 0.0
        )

    @property
    def has_map(self) -> bool:
        """Whether the contact gives the pressure at each pixel."""
        return "pixels" in self.stated["contact"]

    # -- time ---------------------------------------------------------------------------------------------------------

    def _seconds(self, section: str, name: str = "cpu_seconds") -> float | None:
        seconds = self.stated.get(section, {}).get(name)
        return None if seconds is None else seconds * self.slowness

    @property
    def contact_cpu_seconds(self) -> float | None:
        """Of surface and contact, and of other stages in their keys."""
        seconds = self._seconds("contact")
        return None if seconds is None else seconds + self._of_others(KEYS[:2])

    def _of_others(self, keys: Sequence[str]) -> float:
        """CPU seconds of the stages in these keys, but for those that contact and ageing state themselves."""
        stages = [stage for stage in registry.stages() if stage.key in keys]
        own = {"surface", "contact", "engine", "ageing"}
        return sum(
            self._seconds(stage.section) or 0.0
            for stage in stages
            if stage.section not in own
        )

    @property
    def kinetics_cpu_seconds(self) -> float | None:
        """Of all replicas, and of other stages after the contact."""
        seconds = self._seconds("ageing")
        return None if seconds is None else seconds + self._of_others(KEYS[2:])

    @property
    def kinetics_range(self) -> tuple[float, float] | None:
        """Least and most CPU seconds of all replicas, where no single number can be given."""
        least = self._seconds("ageing", "cpu_seconds_least")
        most = self._seconds("ageing", "cpu_seconds_most")
        return None if least is None or most is None else (least, most)

    def preparation(self) -> float:
        """CPU seconds that the method of ageing may need before its first answer, such as for a table.

        Raises
        ------
        InputError
            The method does not fit the scene.
        """
        scene, parts = self.scene, self.parts
        if scene.ageing is None or scene.hold is None:
            return 0.0
        chemistry, engine = parts["chemistry"], parts["engine"]
        check_method(scene.ageing, chemistry, engine, scene.rupture, scene.observe)
        seconds = expected_cost(
            scene.ageing,
            self.sites or 1.0,
            {
                "cpu_seconds": 0.0
            },  # of kinetics, which may state a range of their own
            1,
            chemistry=chemistry,
            temperature=scene.hold.temperature,
            mean_pressure=self.mean_pressure,
        )
        least = seconds.get("cpu_seconds_least", 0.0)
        return max(0.0, seconds.get("cpu_seconds_most", 0.0) - least)

    @property
    def range_reason(self) -> str:
        """Why the time is a range, where it is one."""
        if self.kinetics_range is None:
            return ""
        by = self.scene.ageing or self.scene.engine
        assert by is not None
        return f"the cost of {by.role} {by.kind!r} depends on what happens during the run"

    @property
    def seconds_range(self) -> tuple[float, float] | None:
        """Least and most CPU seconds, where no single number can be given."""
        kinetics, contact = self.kinetics_range, self.contact_cpu_seconds
        if kinetics is None or contact is None:
            return None
        return contact + kinetics[0], contact + kinetics[1]

    @property
    def at_once(self) -> int:
        """How many replicas run at the same time."""
        method = self.scene.ageing
        if (
            self.scene.hold is None
            or self.scene.engine is None
            or (method is not None and not method.replicates)
        ):
            return 1
        return max(
            1,
            min(
                self.scene.hold.replicas,
                available() // self.scene.engine.concurrency(),
            ),
        )

    def duration(self, *, most: bool = False) -> float | None:
        """Wall time of a run, s; None where a component gives no estimate. ``most``: of a range, its upper end."""
        contact, kinetics = self.contact_cpu_seconds, self.kinetics_cpu_seconds
        if contact is None or kinetics is None:
            return None
        concurrent = self.at_once * (
            self.scene.engine.concurrency() if self.scene.engine is not None else 1
        )
        kinetics = (
            self.kinetics_range[1] if most and self.kinetics_range else kinetics
        )
        return contact / available() + kinetics / min(concurrent, available())

    # -- what is wrong or doubtful ------------------------------------------------------------------------------------

    def check(self) -> None:
        """Refuse a scene that this machine cannot hold, or that changes what it does not compute.

        Raises
        ------
        InputError
            With the numbers and the remedy.
        """
        scene, grids, hold = self.scene, self.parts["grids"], self.scene.hold
        asked = [stage for stage in registry.stages() if stage.asked(self.parts)]
        made = {stage.makes for stage in asked if not stage.changes}
        for stage in asked:
            if stage.changes and stage.makes not in made:
                problem = f"changes what this scene does not compute, {stage.makes!r}; leave it out"
                raise InputError(f"[{stage.section}] {problem}")
        grid = f"{self.surface.get('nx', 0):.0f} x {self.surface.get('ny', 0):.0f} pixels"
        most = max(self.contact_bytes or 0.0, BYTES_PER_PIXEL * self.pixels)
        require(most, f"[surface] {grid}", "use fewer pixels")
        if hold is None:
            return
        if grids and (
            scene.load > 0 or scene.contact.adheres
        ):  # a contact has one pixel at least
            least = grids[1][0] * grids[1][1] / (grids[0][0] * grids[0][1])
            require(
                BYTES_PER_SITE * least,
                f"[chemistry] {least:.3g} sites per pixel",
                "use a smaller site_density",
            )
        times = hold.hold_times.size
        on = (
            f" on {grids[1][0]} x {grids[1][1]} sites"
            if grids and grids[1] != grids[0]
            else ""
        )
        remedy = "ask for fewer replicas, or fewer hold times" + (
            ", or use a smaller site_density" if on else ""
        )
        most = (
            kept_bytes(hold.replicas, times)
            + (self.replica_bytes or 0.0) * self.at_once
        )
        most += self.rupture_bytes
        require(
            most,
            f"[hold] {hold.replicas} replicas at {times} hold times{on}",
            remedy,
        )

    def doubts(self) -> list[Doubt]:
        """Everything to warn of before the scene runs.

        Raises
        ------
        InputError
            A part of the scene would refuse it during the run.
        """
        doubts = [Doubt("long", text)] if (text := self._long_run()) else []
        for stage in registry.stages():
            try:
                doubts += stage.doubts(self.parts, self.stated)
            except InputError as error:
                error.add_note(
                    f"in the stage {stage.section!r} of scene {self.scene.name!r}"
                )
                raise
        return [*doubts, *self._units()]

    def _long_run(self) -> str:
        """What to say of a run that takes hours; "" of any other."""
        seconds = self.duration(most=True)
        if seconds is None or seconds < LONG:
            return ""
        about = "up to" if self.kinetics_range else "about"
        why = f" ({self.range_reason})" if self.kinetics_range else ""
        return (
            f"this will take {about} {in_hours(seconds)} on {available()} threads{why}; fewer replicas or pixels take "
            "less, and with checkpoints an interrupted run resumes"
        )

    def _units(self) -> Iterator[Doubt]:
        """Quantities of a size that nothing has."""
        for section, part in self.parts.items():
            # the parts of a chemistry are sections of their own
            if isinstance(part, Component) and not part.role:
                yield from _unusual(section, part, bonds=True)
                continue
            for path, component in nested(part, section):
                yield from _unusual(path, component, bonds=False)

    # -- what is shown ------------------------------------------------------------------------------------------------

    @cached_property
    def notes(self) -> list[str]:
        """What to know before it runs, in words; :func:`chemage.run` emits each as a ``PlanWarning``."""
        return [doubt.text for doubt in self.doubts()]

    @cached_property
    def stages(self) -> dict[str, str]:
        """What is modelled and what is not, in words."""
        scene = self.scene
        rows: dict[str, str] = {}
        for stage in registry.stages():
            if scene.material and not stage.required:
                values = ", ".join(
                    f"{value.path} = {value.text}" for value in scene.from_material
                )
                rows.setdefault(
                    "material",
                    f"{scene.material}: {values or 'the scene gives every value itself'}",
                )
            rows |= stage.rows(self.parts, self.stated)
        return rows

    @cached_property
    def numbers(self) -> dict[str, float]:
        """nx, ny, area_fraction, sites, cpu_seconds, seconds (wall time), memory (bytes), file (bytes)."""
        numbers: dict[str, float | None] = {}
        if self.pixels:
            # heights are noise and do not compress; a pressure map is as large as what carries pressure
            carrying = (
                1.0
                if self.area_fraction is None
                else min(1.0, 2 * self.area_fraction)
            )
            file = (8 + 8 * carrying) * self.pixels + self.gap_bytes
            sides = {name: self.surface[name] for name in ("nx", "ny")}
            numbers |= {**sides, "file": file}
        if self.pixels or not self.has_map:
            numbers |= {"sites": self.sites, "area_fraction": self.area_fraction}
        contact = self.contact_cpu_seconds
        kinetics = self.kinetics_cpu_seconds
        seconds = self.duration()
        if contact is not None and kinetics is not None:
            numbers["cpu_seconds"] = contact + kinetics
        if self.contact_bytes is not None and self.replica_bytes is not None:
            held = MAP_BYTES * self.pixels + self.gap_bytes
            stages = max(
                self.contact_bytes, held + self.replica_bytes * self.at_once
            )
            stages = max(LIBRARY_BYTES + stages, DRAWING_BYTES + held)
            numbers["memory"] = stages + self.rupture_bytes
        if seconds is not None:
            numbers |= {"seconds": seconds, "machine_speed": 1 / self.slowness}
        if self.seconds_range is not None:
            least, most = self.seconds_range
            numbers |= {"cpu_seconds_least": least, "cpu_seconds_most": most}
        numbers["events"] = self.events
        return {name: value for name, value in numbers.items() if value is not None}

    def seconds_text(self) -> str:
        """The CPU time in words; "" where it is not stated."""
        once = "once kernels are compiled"
        if self.seconds_range and self.seconds_range[1] > SHORT:
            least, most = (_time(value) for value in self.seconds_range)
            return f"{least} to {most} of CPU time {once}: {self.range_reason}"
        seconds = self.numbers.get("cpu_seconds")
        if seconds is None:
            return ""
        return f"{'less than a second' if seconds < SHORT else f'about {_time(seconds)}'} of CPU time {once}"

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
        numbers = self.numbers
        rows = list(self.stages.items())
        if "area_fraction" in numbers:
            rows.append(
                ("expected area fraction", f"{numbers['area_fraction']:.3g}")
            )
        else:
            rows.append(
                ("expected area fraction", "not known before the contact is solved")
            )
        if "sites" in numbers:
            rows.append(
                ("expected sites", f"{numbers['sites']:.3g} in contact per replica")
            )
        if "events" in numbers:
            rows.append(
                (
                    "expected events",
                    f"about {numbers['events']:.2g} bonds formed and broken per site",
                )
            )
        if text := self.seconds_text():
            rows.append(("expected cost", text))
        if text and "machine_speed" in numbers:
            rows.append(
                (
                    "speed of this machine",
                    f"{numbers['machine_speed']:.2g} times the reference, measured once",
                )
            )
        if "memory" in numbers:
            rows.append(
                ("expected memory", f"about {numbers['memory'] / 1e9:.2g} GB")
            )
        if "file" in numbers:
            rows.append(("result file", f"about {numbers['file'] / 1e6:.3g} MB"))
        return rows


def cost(scene: Scene, *, here: bool = True) -> Plan:
    """The one estimate of what ``scene`` costs, from what its components state; single scenes and sweeps use it.

    Seconds are those of this machine (:func:`chemage.foundation.machine.slowness`), or with ``here`` False those of
    the machine on which components were calibrated.

    Raises
    ------
    ChemageError
        A surface file cannot be read.
    """
    stated: dict[str, Mapping[str, float]] = {}
    with scene.in_use():
        parts = scene.solved_parts
        for stage in registry.stages():
            if (
                stage.section not in parts and stage.section != "ageing"
            ):  # where there is no method, all sites age
                continue
            try:
                stated[stage.section] = stage.estimate(parts, stated)
            except ChemageError as error:
                error.add_note(f"in [{stage.section}] of scene {scene.name!r}")
                raise
        if "pixels" not in stated["contact"]:
            stated["surface"] = {
                name: value
                for name, value in stated["surface"].items()
                if name not in _MAP
            }
        return Plan(scene, parts, stated, slowness() if here else 1.0)


def plan(scene: Scene) -> Plan:
    """The :class:`Plan` of ``scene``, checked.

    Raises
    ------
    InputError
        It needs more memory than this machine has, or its parts do not fit together.
    """
    with scene.in_use():
        checked = cost(scene)
        checked.check()
        _ = checked.notes
    return checked


def _unusual(path: str, component: Component, *, bonds: bool) -> Iterator[Doubt]:
    for name, unit in units_of(type(component)).items():
        value = getattr(component, name)
        usual = BOND_FORCES if unit == "nN" and bonds else USUAL.get(unit)
        if usual is None or not isinstance(value, int | float) or not value:
            continue
        if not usual[0] <= abs(value) <= usual[1]:
            text = f"{usual[2]}; a bare number is in {unit}, give another unit as text, {usual[3]}"
        elif unit == "eV" and value < 0 and component.role == "barriers":
            text = "a barrier is not negative"
        else:
            continue
        option = f"{path}.{name}"
        yield Doubt(f"unit of {option}", f"{option} = {value:g} {unit}: {text}")


def in_hours(seconds: float) -> str:
    """A long time in minutes, hours or days."""
    if seconds < LONG:
        return f"{seconds / 60:.2g} minutes"
    if seconds < 48 * 3600:
        return f"{seconds / 3600:.2g} hours"
    return f"{seconds / 86400:.3g} days"


def _time(seconds: float) -> str:
    if seconds >= 120:
        return in_hours(seconds)
    return f"{seconds:.0f} s" if seconds >= 10 else f"{seconds:.2g} s"
