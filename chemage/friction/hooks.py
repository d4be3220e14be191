"""What can be plugged into this stage: rupture laws, the hook that gives the force that breaks the bonds, and engines
that follow them while the contact is pulled."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from typing import TYPE_CHECKING, Any

from chemage.plugins.hooks import Doubt, Parts, Stage, Stated, hookimpl, hookspec

if TYPE_CHECKING:
    import numpy as np

    from chemage.contacts.solution import ContactSolution
    from chemage.foundation.checks import Seed
    from chemage.friction.pulling import Drive, Partners, PullHistory, Pulling
    from chemage.friction.role import Bonded, Rupture
    from chemage.kinetics.history import BondHistory
    from chemage.kinetics.role import Ramp
    from chemage.lattices.chemistry import Chemistry
    from chemage.lattices.lattice import ReactionLattice

ROLES = {
    "rupture": "chemage.friction.role:Rupture",
    "pulling": "chemage.friction.pulling:Pulling",
}


@hookspec(firstresult=True)
def chemage_rupture_bonds(
    rupture: Rupture | None, bonded: Bonded
) -> np.ndarray | None:
    """Give the force in nN that breaks the bonds after each hold time, (m,), finite and not negative.

    Return None to leave it to the next plugin; chemage itself answers last. Called once per replica.
    """


@hookspec(firstresult=True)
def chemage_pull_bonds(
    engine: Pulling,
    lattice: ReactionLattice,
    drive: Drive,
    times: np.ndarray,
    temperature: float,
    seed: Seed,
    start: PullHistory | BondHistory | np.ndarray | None,
    partners: Partners | None,
    contact: ContactSolution | None,
    chemistry: Chemistry | None,
    ramp: Ramp | None,
) -> PullHistory | None:
    """Pull at the bonds of one replica. Return None to leave it to the next plugin; chemage itself answers last.

    ``ramp``: what temperature and barriers become by the last of the times, None where they stay.
    ``contact`` and ``chemistry`` are what the lattice was made from, None where it was made by hand. Called once for
    each pull, never per event.
    """


class OwnRuptureMethod:
    """The law's own method; without a law, the mean force per bond and the front factor of the chemistry; the engine's
    own method."""

    @hookimpl(trylast=True)
    def chemage_rupture_bonds(
        self, rupture: Rupture | None, bonded: Bonded
    ) -> np.ndarray:
        if rupture is not None:
            import numpy as np

            return np.asarray(rupture.force(bonded))
        return bonded.bonds * (
            bonded.chemistry.bond_force * bonded.chemistry.front_factor
        )

    @hookimpl(trylast=True)
    def chemage_pull_bonds(
        self,
        engine: Pulling,
        lattice: ReactionLattice,
        drive: Drive,
        times: np.ndarray,
        temperature: float,
        seed: Seed,
        start: PullHistory | BondHistory | np.ndarray | None,
        partners: Partners | None,
        ramp: Ramp | None,
    ) -> PullHistory:
        return engine.run(
            lattice,
            drive,
            times,
            temperature=temperature,
            seed=seed,
            start=start,
            partners=partners,
            ramp=ramp,
        )


ANSWERS = OwnRuptureMethod


class _Rupture(Stage):
    def fault(self, answer: Any, arguments: Mapping[str, Any]) -> str:
        import numpy as np

        if "drive" in arguments:
            return answer.fault() or answer.fault_of(**arguments)
        times = arguments["bonded"].hold_times.size
        if answer.dtype.kind not in "fiu":
            problem = f"gave values of type {answer.dtype}"
        elif answer.shape != (times,):
            problem = (
                f"gave an array of shape {answer.shape} for {times} hold times"
            )
        elif bad := int(np.count_nonzero(~np.isfinite(answer))):
            problem = f"gave {bad} forces of {times} that are not finite"
        elif (answer < 0).any():
            problem = f"gave a negative force, {float(answer.min()):.4g} nN"
        else:
            return ""
        return f"{problem}; give one force in nN, not negative, for each hold time"

    def _known(self, parts: Parts, stated: Stated) -> dict[str, Any]:
        """What the estimates of a rupture law are offered: the hold times, s, and the mean pressure in contact, GPa."""
        pressure = stated.get("chemistry", {}).get("pressure", 0.0)
        return {"times": parts["hold"].hold_times, "pressure": pressure}

    def estimate(self, parts: Parts, stated: Stated) -> Mapping[str, float]:
        from chemage.foundation.components import call_with

        sites = stated.get("chemistry", {}).get("sites")
        if sites is None or "hold" not in parts:
            return {}
        hold, known = parts["hold"], self._known(parts, stated)
        known |= {"chemistry": parts["chemistry"], "temperature": hold.temperature}
        return call_with(
            parts[self.section].expected,
            sites,
            hold.hold_times.size,
            hold.replicas,
            **known,
        )

    def rows(self, parts: Parts, stated: Stated) -> Mapping[str, str]:
        if "engine" not in parts or self.section in parts:
            return super().rows(parts, stated)
        chemistry = parts["chemistry"]
        mean = f"mean force of {chemistry.bond_force:g} nN per bond, front factor {chemistry.front_factor:g}"
        return {self.section: mean}

    def doubts(self, parts: Parts, stated: Stated) -> Iterator[Doubt]:
        from chemage.foundation.components import call_with

        if self.section in parts and "hold" in parts:
            known = {
                "sites": stated.get("chemistry", {}).get("sites"),
                **self._known(parts, stated),
            }
            check = parts[self.section].check
            for text in (
                call_with(
                    check, parts["chemistry"], parts["hold"].temperature, **known
                )
                or ()
            ):
                yield Doubt("parts", text)

    def doubts_of_sweep(
        self, parts: Parts, varied: Collection[str]
    ) -> Iterator[Doubt]:
        if (
            "hold.temperature" in varied
            and "hold" in parts
            and self.section not in parts
        ):
            force = parts["chemistry"].bond_force
            yield Doubt(
                "bond force",
                f"bonds break at {force:g} nN at every temperature, as no [rupture] says otherwise: the temperature "
                "changes their number alone; choose a law by which bonds break under force",
            )


STAGES = (
    _Rupture(
        "rupture",
        role="rupture",
        needs="forming",
        only_with="hold",
        inputs=("ageing",),
        key="ageing",
        hooks=("chemage_rupture_bonds", "chemage_pull_bonds"),
    ),
)
