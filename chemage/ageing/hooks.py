"""What can be plugged into this stage: observables, methods of ageing, the hook that measures on a replica, and what
reports show beside its curves."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from chemage.plugins.hooks import Doubt, Parts, Stage, StageInputs, Stated, hookspec

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from chemage.ageing.ageing import Ageing
    from chemage.ageing.observables import PlottedResult
    from chemage.contacts.solution import ContactSolution
    from chemage.kinetics.history import BondHistory
    from chemage.lattices.lattice import ReactionLattice

ROLES = {
    "observable": "chemage.ageing.observables:Observable",
    "ageing": "chemage.ageing.methods:AgeingMethod",
}


@hookspec
def chemage_observe(
    contact: ContactSolution, lattice: ReactionLattice, history: BondHistory
) -> Mapping[str, Any]:  # pyright: ignore[reportReturnType]
    """Measure named numbers or arrays on a finished replica; they are kept in ``Ageing.observables``."""


@hookspec
def chemage_figures() -> Mapping[
    str, tuple[str, Callable[[Axes, Sequence[PlottedResult]], None]]
]:  # pyright: ignore[reportReturnType]
    """Bring figures: ``{name: (caption, function that draws the results into the axes)}``."""


@hookspec
def chemage_published() -> Sequence[tuple[Mapping[str, object], float, str]]:  # pyright: ignore[reportReturnType]
    """Say what was published: ``[(where, beta, source), ...]``, β per decade of the scenes whose fields are ``where``
    (dotted path -> value, internal units); drawn beside the fitted line of such a result."""


def method_of(parts: Parts) -> Any:
    """The method by which a scene with these parts ages; None: the kinetics of every site."""
    from chemage.plugins.registry import current

    stages = (stage for stage in current().stages() if stage.section in parts)
    return next(filter(None, (stage.method(parts) for stage in stages)), None)


def arguments_of(parts: Mapping[str, Any]) -> dict[str, Any]:
    """What the parts of a scene say of the arguments of :func:`chemage.age` but surface, contact and chemistry."""
    from chemage.friction.role import Rupture

    hold = parts["hold"]
    return dict(
        **{
            name: getattr(hold, name)
            for name in ("hold_times", "temperature", "replicas", "seed", "common")
        },
        engine=parts["engine"],
        solver=parts["contact"],
        method=method_of(parts),
        rupture=parts.get(Rupture.role),
        observe=parts.get("observe", ()),
    )


class _Ageing(Stage):
    def method(self, parts: Parts) -> Any:
        return parts[self.section]

    def taken(self, parts: Parts) -> tuple[str, ...]:
        method = method_of(parts)
        loads = method is not None and method.loads
        return (*self.takes, *(("surface",) if loads else ()))

    def asked(self, parts: Parts) -> bool:
        return {"chemistry", "engine", "hold"} <= parts.keys()

    def run(self, inputs: StageInputs) -> Ageing:
        from chemage.ageing.age import age

        how = {
            name: getattr(inputs, name)
            for name in ("threads", "progress", "checkpoints")
        }
        return age(
            inputs.made["contact"],
            inputs.parts["chemistry"],
            surface=inputs.made.get("surface"),
            **arguments_of(inputs.parts),
            **how,
        )

    def problems(self, parts: Parts) -> Iterable[tuple[str, str]]:
        from chemage.ageing.methods import EVERY_SITE, check_contact, check_method
        from chemage.foundation.errors import InputError
        from chemage.friction.role import Rupture

        if "engine" not in parts:
            return
        method = method_of(parts) or EVERY_SITE
        contact = parts["contact"]
        chemistry = parts["chemistry"]
        rupture, observe = parts.get(Rupture.role), parts.get("observe", ())
        try:
            check_contact(
                f"contact {contact.kind!r}", contact.gives_map, method, chemistry
            )
            check_method(method, chemistry, parts["engine"], rupture, observe)
        except InputError as error:
            path = self.section if self.section in parts else "engine"
            yield from [
                (f"{path}.{name}", text) for name, text in error.problems
            ] or [(path, str(error))]

    def estimate(self, parts: Parts, stated: Stated) -> Mapping[str, float]:
        """``cpu_seconds`` of all replicas, with least and most where it is a range, and ``bytes`` of one of them."""
        from chemage.ageing.methods import EVERY_SITE, expected_cost, wants_states
        from chemage.friction.role import Rupture

        if "engine" not in parts:
            return {"cpu_seconds": 0.0, "bytes": 0.0}
        hold = parts["hold"]
        method = method_of(parts) or EVERY_SITE
        replica = stated["engine"]
        mapped = "pixels" in stated["contact"]
        sites = stated["chemistry"].get("sites") if mapped else 0.0
        if sites is None:
            return {}
        if not mapped and method is EVERY_SITE:
            return {"cpu_seconds": 0.0, "bytes": 0.0}
        numbers = expected_cost(
            method,
            sites,
            replica,
            hold.replicas,
            chemistry=parts["chemistry"],
            temperature=hold.temperature,
            mean_pressure=stated["contact"].get("mean_pressure"),
        )
        asking = parts["engine"], parts.get(Rupture.role), parts.get("observe", ())
        if "bytes" in numbers and method is EVERY_SITE and wants_states(*asking):
            numbers["bytes"] += sites * hold.hold_times.size
        return numbers

    def rows(self, parts: Parts, stated: Stated) -> Mapping[str, str]:
        if (method := parts.get(self.section)) is None:
            return {}
        means = "" if method.replicates else ": the mean over replicas alone"
        return {
            self.section: f"{method.kind}, instead of the kinetics of every site{means}"
        }

    def doubts(self, parts: Parts, stated: Stated) -> Iterator[Doubt]:
        from chemage.lattices.site_grid import site_shape

        surface, method = stated["surface"], parts.get(self.section)
        if "engine" not in parts:
            return
        if {"nx", "ny", "pixel_size"} <= surface.keys():
            pixels = int(surface["nx"]), int(surface["ny"])
            shape = site_shape(
                pixels, surface["pixel_size"], parts["chemistry"].site_density
            )
            if method is not None:
                for text in (
                    method.check_sites(shape, stated["chemistry"].get("sites"))
                    or ()
                ):
                    yield Doubt("parts", text)
        yield from self._pressure(parts, stated)
        yield from self._adhesion(parts, stated)
        yield from self._bonds(parts, stated)

    def _pressure(self, parts: Parts, stated: Stated) -> Iterator[Doubt]:
        """A mean pressure at which the material would flow."""
        from chemage.ageing.ageing import NOTED_ELASTIC

        hardness = parts["chemistry"].hardness
        mean = stated["contact"].get("mean_pressure")
        if (
            hardness is None
            or mean is None
            or stated["contact"].get("max_pressure", math.inf) <= hardness
        ):
            return
        ratio = hardness / mean
        # Hertz: p0 = 3/2 of the mean; rough: a Rayleigh distribution
        tip = "radius" in stated["surface"]
        share = (
            max(1 - (ratio / 1.5) ** 2, 0.0)
            if tip
            else math.exp(-math.pi / 4 * ratio**2)
        )
        if share > NOTED_ELASTIC or mean > hardness:
            yield Doubt(
                "hardness",
                f"the mean contact pressure is expected to be {mean:.3g} GPa, with {100 * share:.0f} % of the contact "
                f"area above the hardness of {hardness:g} GPa, where the material would flow: use a smaller load or "
                "rms slope, or check modulus and hardness",
            )

    def _adhesion(self, parts: Parts, stated: Stated) -> Iterator[Doubt]:
        """Adhesion of a sphere that the contact leaves out."""
        from chemage.ageing.ageing import neglected_adhesion

        work = parts["chemistry"].work_of_adhesion
        radius = stated["surface"].get("radius")
        load = parts["contact.load"]
        if work is None or radius is None or load <= 0 or parts["contact"].adheres:
            return
        if text := neglected_adhesion(work, 2 * math.pi * work * radius / load):
            yield Doubt("adhesion", text)

    def _bonds(self, parts: Parts, stated: Stated) -> Iterator[Doubt]:
        """Hold times and temperature beside the barriers."""
        import numpy as np

        from chemage.foundation.units import KB, celsius_meant

        chemistry = parts["chemistry"]
        hold = parts["hold"]
        expected = stated["chemistry"]
        times, nu = hold.hold_times, chemistry.attempt_frequency
        lowest, median, highest = map(
            float, chemistry.forming.quantile(np.array([0.05, 0.5, 0.95]))
        )
        active = KB * hold.temperature * np.log(max(nu * times[-1], 1.0))
        if median < 0:
            text = f"half of the forming barriers are below {median:.3g} eV: no barrier is left to cross"
            yield Doubt("barriers", text)
        if cold := celsius_meant("hold.temperature", hold.temperature):
            yield Doubt("temperature", cold)
        if (
            {"bonded", "sites"} <= expected.keys()
            and times[-1] > 0
            and parts["contact.load"] > 0
        ):
            bonds = expected["bonded"] * expected["sites"] * hold.replicas
            if bonds < NO_BOND and expected["sites"] >= NO_SITE:
                few = f"{bonds:.1g}" if bonds > 1e-3 else "none"
                why = "bonds break sooner than they form, or few sites are reactive"
                if active < lowest:
                    react = f"barriers up to {active:.2f} eV react"
                    why = f"{react}, and 95 % of the forming barriers are above {lowest:.2f} eV"
                where = f"at {hold.temperature:g} K and {times[-1]:g} s"
                yield Doubt(
                    "bonds",
                    f"no bond is expected {where}, {few} in all replicas together: {why}",
                )
                return
        if active < lowest:
            react = f"by {times[-1]:g} s only barriers up to {active:.2f} eV react"
            yield Doubt("bonds", f"{react}, below 95 % of the forming barriers")
        elif (
            KB * hold.temperature * np.log(max(nu * max(times[0], 1e-300), 1.0))
            > highest
        ):
            yield Doubt(
                "bonds",
                f"at {times[0]:g} s nearly every forming barrier is already crossed; start earlier",
            )


class _Observe(Stage):
    def problems(self, parts: Parts) -> Iterable[tuple[str, str]]:
        from chemage.ageing.observables import output_problems

        sections = {"observable": self.section, "barriers": "forming"}
        for component, problem in output_problems(dict(parts)):
            yield sections.get(component.role, component.role), problem


#: sites, and bonds of all replicas together, below which a scene gives no number
NO_SITE, NO_BOND = 1.0, 1.0
STAGES = (
    _Ageing(
        "ageing",
        role="ageing",
        needs="forming",
        only_with="hold",
        inputs=("engine",),
        takes=("contact",),
        makes="ageing",
    ),
    _Observe(
        "observe",
        role="observable",
        many=True,
        inputs=("hold",),
        key="ageing",
        always_in_key=True,
        hooks=("chemage_observe",),
    ),
)
