"""What can be plugged into this stage: rupture laws, and the hook that gives the force that breaks the bonds."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

from chemage.plugins.hooks import Doubt, Parts, Stage, Stated, hookimpl, hookspec

if TYPE_CHECKING:
    import numpy as np

    from chemage.friction.role import Bonded, Rupture

ROLES = {"rupture": "chemage.friction.role:Rupture"}


@hookspec(firstresult=True)
def chemage_rupture_bonds(rupture: Rupture | None, bonded: Bonded) -> np.ndarray | None:
    """Give the force in nN that breaks the bonds after each hold time, (m,), finite and not negative.

    Return None to leave it to the next plugin; chemage itself answers last. Called once per replica.
    """


class Default:
    """The law's own method; without a law, the mean force per bond and the front factor of the chemistry."""

    @hookimpl(trylast=True)
    def chemage_rupture_bonds(self, rupture: Rupture | None, bonded: Bonded) -> np.ndarray:
        if rupture is not None:
            import numpy as np

            return np.asarray(rupture.force(bonded))
        return bonded.bonds * (bonded.chemistry.bond_force * bonded.chemistry.front_factor)


class _Rupture(Stage):
    def fault(self, answer: Any, arguments: Mapping[str, Any]) -> str:
        import numpy as np

        times = arguments["bonded"].hold_times.size
        if answer.dtype.kind not in "fiu":
            problem = f"gave values of type {answer.dtype}"
        elif answer.shape != (times,):
            problem = f"gave an array of shape {answer.shape} for {times} hold times"
        elif bad := int(np.count_nonzero(~np.isfinite(answer))):
            problem = f"gave {bad} forces of {times} that are not finite"
        elif (answer < 0).any():
            problem = f"gave a negative force, {float(answer.min()):.4g} nN"
        else:
            return ""
        return f"{problem}; give one force in nN, not negative, for each hold time"

    def rows(self, parts: Parts, stated: Stated) -> Mapping[str, str]:
        if "engine" not in parts or self.section in parts:
            return super().rows(parts, stated)
        chemistry = parts["chemistry"]
        mean = f"mean force of {chemistry.bond_force:g} nN per bond, front factor {chemistry.front_factor:g}"
        return {self.section: mean}

    def doubts(self, parts: Parts, stated: Stated) -> Iterator[Doubt]:
        if self.section in parts and "hold" in parts:
            for text in parts[self.section].check(parts["chemistry"], parts["hold"].temperature) or ():
                yield Doubt("parts", text)


STAGES = (
    _Rupture(
        "rupture",
        role="rupture",
        needs="forming",
        only_with="hold",
        inputs=("ageing",),
        key="aging",
        hooks=("chemage_rupture_bonds",),
    ),
)
