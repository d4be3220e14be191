"""What can be plugged into this stage: kinetic Monte Carlo engines, and the hook that runs one replica."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

from chemage.plugins.hooks import Doubt, Parts, Stage, Stated, hookimpl, hookspec

if TYPE_CHECKING:
    import numpy as np

    from chemage.contacts.solution import ContactSolution
    from chemage.foundation.checks import Seed
    from chemage.kinetics.history import BondHistory
    from chemage.kinetics.role import Engine, Ramp
    from chemage.lattices.chemistry import Chemistry
    from chemage.lattices.lattice import ReactionLattice

ROLES = {"engine": "chemage.kinetics.role:Engine"}


@hookspec(firstresult=True)
def chemage_run_kinetics(
    engine: Engine,
    lattice: ReactionLattice,
    hold_times: np.ndarray,
    temperature: float,
    seed: Seed,
    start: BondHistory | None,
    contact: ContactSolution | None,
    chemistry: Chemistry | None,
    ramp: Ramp | None,
) -> BondHistory | None:
    """Run one replica. Return None to leave it to the next plugin; chemage itself answers last.

    ``ramp``: what temperature and barriers become by the last hold time, None where they stay. ``contact`` and
    ``chemistry`` are what the lattice was made from, None where an engine is run on a lattice by hand.
    Called once per replica (once per piece where checkpoints are kept; ``start`` is then the piece before), never per
    event.
    """


class OwnEngineMethod:
    """The engine's own method."""

    @hookimpl(trylast=True)
    def chemage_run_kinetics(
        self,
        engine: Engine,
        lattice: ReactionLattice,
        hold_times: np.ndarray,
        temperature: float,
        seed: Seed,
        start: BondHistory | None,
        ramp: Ramp | None,
    ) -> BondHistory:
        return engine.run(
            lattice,
            hold_times,
            temperature=temperature,
            seed=seed,
            start=start,
            ramp=ramp,
        )


ANSWERS = OwnEngineMethod


#: CPU seconds of a replica beside its engine, and for each of its sites (half of it where none interacts): measured on
#: a 2-core Intel Xeon machine (``tests/benchmarks/estimates.py``)
REPLICA_SECONDS, SITE_SECONDS = 2.5e-3, 1e-6
#: what is stated of CPU seconds: one number, and its least and most where it is a range
SECONDS = ("cpu_seconds", "cpu_seconds_least", "cpu_seconds_most")
#: of the lattice of a replica, bytes per site, without neighbours and with eight (``tests/benchmarks/memory.py``)
LATTICE_BYTES = (24.0, 104.0)
#: of the contact on which kernels are compiled: pixels along its sides, a quarter of them in contact; least number of
#: sites; and pixels where the surface does not say them, nm
PIXELS, SITES, PIXEL_SIZE = 4, 12, 0.45


class _Engine(Stage):
    def estimate(self, parts: Parts, stated: Stated) -> Mapping[str, float]:
        """Of one replica on all sites: ``cpu_seconds``, with least and most where it is a range, and ``bytes``."""
        from chemage.foundation.components import call_with

        sites = stated["chemistry"].get("sites")
        events = stated["chemistry"].get("events")
        if (
            sites is None or "pixels" not in stated["contact"]
        ):  # without a map there is no site in memory
            return {}
        coupled = "interaction" in parts
        replica = dict(
            call_with(parts[self.section].expected, sites, coupled, events=events)
        )
        for name in (name for name in SECONDS if name in replica):
            replica[name] += (
                REPLICA_SECONDS
                + (SITE_SECONDS if coupled else SITE_SECONDS / 2) * sites
            )
        if "bytes" in replica:
            replica["bytes"] += LATTICE_BYTES[coupled] * sites
        return replica

    def fault(self, answer: Any, arguments: Mapping[str, Any]) -> str:
        return answer.fault() or answer.fault_of(**arguments)

    def rows(self, parts: Parts, stated: Stated) -> Mapping[str, str]:
        if (engine := parts.get(self.section)) is None:
            return {}
        hold, method = parts["hold"], parts.get("ageing")
        times = hold.hold_times
        replicas = (
            f", {hold.replicas} replicas, seed {hold.seed}"
            if method is None or method.replicates
            else ""
        )
        held = f"{hold.temperature:g} K, {times.size} hold times from {times[0]:g} to {times[-1]:g} s{replicas}"
        return {"kinetics": f"{engine.kind}, {held}"}

    def doubts(self, parts: Parts, stated: Stated) -> Iterator[Doubt]:
        if self.section in parts:
            parts[self.section].check_states(parts["chemistry"].states)
            for text in parts[self.section].check("interaction" in parts) or ():
                yield Doubt("parts", text)

    def warm_up(self, parts: Parts) -> None:
        """Compile what lattice and kinetics need, on a contact of a few pixels under 1 GPa."""
        import numpy as np

        from chemage.contacts.solution import ContactSolution
        from chemage.lattices.chemistry import build_lattice

        solver = parts["contact"]
        if self.section not in parts or not solver.gives_map:
            return
        surface, density = (
            parts["surface"].expected(),
            parts["chemistry"].site_density,
        )
        pixel = surface.get("pixel_size", PIXEL_SIZE)
        n = (
            PIXELS
            if isinstance(density, str)
            else max(PIXELS, round(SITES / (pixel * density**0.5)))
        )
        pressure = np.zeros((n, n))
        pressure[n // 4 : n // 4 + n // 2, n // 4 : n // 4 + n // 2] = 1.0
        contact = ContactSolution(
            pressure=pressure,
            gap=np.where(pressure > 0, 0.0, pixel)
            if getattr(solver, "gap", False)
            else None,
            load=float(pressure.sum()) * pixel**2,
            pixel_size=pixel,
            modulus=getattr(solver, "modulus", 1.0),
            periodic=bool(surface.get("periodic", 1)),
        )
        chemistry = parts["chemistry"]
        if isinstance(
            density, str
        ):  # the sites of a surface are some of its pixels
            chemistry = chemistry.replace(site_density="pixel")
        parts[self.section].warm_up(
            build_lattice(chemistry, contact), parts["hold"].temperature
        )


STAGES = (
    _Engine(
        "engine",
        role="engine",
        required_with=("forming", "is required where bonds form"),
        needs="forming",
        only_with="hold",
        inputs=("chemistry",),
        key="ageing",
        always_in_key=True,
        hooks=("chemage_run_kinetics",),
    ),
)
