"""A component inside a component."""

from __future__ import annotations

from chemage.plugin import Choice, Engine


class Outer(Engine):
    """Another engine does the work."""

    kind = "outer"
    inner: Choice[Engine]
    """the engine"""

    def _run(self, lattice, hold_times, temperature, seed, start):
        return self.inner.run(lattice, hold_times, temperature=temperature, seed=seed, start=start)
