"""b of 1 mm² of rough silica at 5 MPa against temperature, and what it costs: python tests/benchmarks/square_millimetre.py.

Contact ``persson`` with κ = 2.2 and ageing ``closure``, whose tables go to an empty folder, over 10 to 10⁴ s. The interval
contains the error of ``closure`` and that of the area, to which b is in proportion; not the barriers, which are assumed, nor
the shape of the distribution of pressures. CPU seconds of the table by contact: full, full without interaction, thinned.
"""

from __future__ import annotations

import argparse
import math
import tempfile
import time
from collections import Counter, defaultdict
from typing import Any

import chemage as ca
from chemage_ageing import _table

SCENE = {
    "surface.pixels": 2213370,
    "surface.zeta": 1e6,
    "contact": {"kind": "persson", "modulus": "35.3 GPa", "kappa": 2.2, "load": "5 MPa"},
    "observe": [],
}


def main(celsius: list[float]) -> None:
    """Print a line for each temperature."""
    run, seconds, events = _table.run_kinetics, defaultdict[str, float](float), Counter[str]()

    def timed(engine: Any, lattice: Any, *args: Any, **options: Any) -> Any:
        begin = time.process_time()
        history = run(engine, lattice, *args, **options)
        name = "thinned" if lattice.sites.size < _table.SIDE**2 else "full"
        name = "alone" if lattice.coupling is None else name
        seconds[name] += time.process_time() - begin
        events[name] += history.events
        return history

    _table.run_kinetics = timed
    for kelvin in (one + 273.15 for one in celsius):
        with tempfile.TemporaryDirectory() as folder:
            seconds.clear()
            events.clear()
            ageing = {"kind": "closure", "folder": folder}
            scene = ca.load_scene("silica-rough", {**SCENE, "ageing": ageing, "hold.temperature": kelvin})
            begin = time.process_time()
            done = ca.run(scene)
            first = time.process_time() - begin
            begin = time.process_time()
            ca.run(scene)
            again = time.process_time() - begin
        assert done.ageing is not None
        (beta,) = (one for one in done.ageing.quantities(done.window) if one.name == "beta")
        b, closure = beta.value / math.log(10), 1.96 * beta.errors["closure"].size / math.log(10)
        area = done.contact.approximate[0]["declared_error"]
        half = math.hypot(closure, area * b)
        print(
            f"{kelvin - 273.15:g} °C: b {b:.4f} [{b - half:.4f}, {b + half:.4f}]",
            f"(closure ± {closure:.4f}, area ± {area:.1%});",
            f"Δμ {done.ageing.mean_friction_coefficient_drop[-1]:.3f} in the end;",
            f"{first:.0f} CPU s, again {again:.2f};",
            *(f"{name} {seconds[name]:.0f} s, {events[name]:.1e} events;" for name in seconds),
            flush=True,
        )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("celsius", type=float, nargs="*", default=[25.0, 100.0, 200.0, 300.0])
    main(parser.parse_args().celsius)
