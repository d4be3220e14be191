"""β of an adhesive silica tip at the loads of the published ones, 15 at 23 nN and 1.5 at 393 nN.

    python tests/benchmarks/tip_adhesion.py

The scene ``silica-tip`` with the contacts ``hertz``, ``jkr`` and ``dmt``. The work of adhesion of the measured tips is
not published, so that it is varied. Sites under tension react or not (``tensile_sites``).
"""

from __future__ import annotations

from typing import Any

import chemage as ca

LOADS = (23.0, 393.0)
MEASURED = {23.0: 15.0, 393.0: 1.5}


def beta(radius: float, load: float, contact: dict[str, Any], tensile: bool = True) -> tuple[float, float]:
    """β and the contact area (nm²)."""
    changes = {f"contact.{name}": value for name, value in contact.items()}
    changes |= {"surface.radius": radius, "surface.pixels": 96, "contact.load": load}
    changes |= {"hold.replicas": 40, "hold.temperature": 300.0, "chemistry.tensile_sites": tensile}
    changes["chemistry.site_density"] = "pixel"
    run: Any = ca.run(ca.load_scene("silica-tip", changes), warn=False)
    return run.ageing.fit().beta, run.contact.area


def main() -> None:
    print("radius, w, contact, sites: β at 23 nN, at 393 nN, their bonds per decade as a ratio (1.7 measured), areas")
    for radius in (30.0, 100.0):
        for work in (0.0, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0):
            kinds = ("jkr", "dmt") if work else ("hertz",)
            for kind in kinds:
                contact: dict[str, Any] = {"kind": kind} | ({"work_of_adhesion": work} if work else {})
                for tensile in (True, False) if kind == "jkr" else (True,):
                    try:
                        (low, small), (high, large) = (beta(radius, load, contact, tensile) for load in LOADS)
                    except ca.ChemageError as error:
                        print(f"{radius:g} nm, {work} J/m², {kind}: {error}")
                        continue
                    ratio = high * LOADS[1] / (low * LOADS[0])
                    print(
                        f"{radius:g} nm, {work} J/m², {kind}, {'all' if tensile else 'pressed'}: {low:.3g} "
                        f"({low / MEASURED[23.0]:.2f} of 15), {high:.3g} ({high / MEASURED[393.0]:.2f} of 1.5), "
                        f"{ratio:.2f}, {small:.0f} and {large:.0f} nm², Tabor at 0.3 nm "
                        f"{(radius * work**2 / (35.3**2 * 0.3**3)) ** (1 / 3):.2f}",
                        flush=True,
                    )


if __name__ == "__main__":
    main()
