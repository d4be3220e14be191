"""The number of bonds from the statistics of a contact, without the kinetics of its sites."""

from __future__ import annotations

import math
import threading
from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar

import numpy as np
from pydantic import Field

from chemage import (
    AgedBonds,
    AgeingMethod,
    AgeingRequest,
    Chemistry,
    Choice,
    ContactStatistics,
    Engine,
    InputError,
    contact_statistics,
    coordination,
)
from chemage_ageing import _keeping, _table
from chemage_ageing._independent import bonded_share

#: largest and rms relative error of the mean number of bonds, measured on contacts that tuned nothing
#: (``tests/benchmarks/closure_errors.py``)
LARGEST_ERROR, RMS_ERROR = 0.015, 0.004
#: the same of sites that do not interact: the quadrature
INDEPENDENT_ERROR = 2e-4
#: CPU seconds of a table at the default accuracy, at most, measured on rough contacts and tips of silica
TABLE_SECONDS = 100.0
#: of the share of the sites under the highest pressures, the change is taken at the pressure at which they begin
TAIL = 1e-6
#: the most pressures of a table
MOST_NODES = 4000

_lock = threading.Lock()
#: file, and what took part in the table -> its nodes
_tables: dict[tuple[Path, str], dict[int, _table.Node]] = {}


class Closure(AgeingMethod):
    """Bonds per area as a function of pressure and time, plus the term of the rim, over the statistics of the contact.

    A site under the pressure p that lacks the share x of its neighbours is bonded with the probability
    ρ(p, t) = ρ₀ + δ (1 − x²) + a (x − x²): ρ₀ of a site that does not interact, exactly; δ, by which the interaction
    changes it inside a uniform contact; a, the term of the rim. δ and a are tabulated once for each chemistry and
    temperature by the kinetics of uniform contacts and of stripes of them, and kept in the cache folder of the user; an
    isolated site (x = 1) has ρ₀. Left out are correlations between sites under different pressures, and which sites
    lack the neighbours. It gives the mean number of bonds: no replicas, no scatter, no states.
    """

    kind = "closure"
    exact: ClassVar[bool] = False
    declared_error: ClassVar[float | None] = LARGEST_ERROR
    replicates: ClassVar[bool] = False
    needs_map: ClassVar[bool] = False
    speed_only: ClassVar[tuple[str, ...]] = ("folder",)
    trade: ClassVar[Mapping[str, tuple[float, ...]]] = {"accuracy": (0.02, 0.01, 0.005)}

    accuracy: float = Field(default=0.005, ge=1e-4, le=0.2)
    """relative standard error of the table, at each of its pressures and at each decade of time"""
    engine: Choice[Engine] = Field(default="next-reaction", validate_default=True)
    """engine of the table; it must be able to give the states of the sites"""
    folder: str = ""
    """folder in which tables are kept; default: the cache folder of the user"""

    def check(self, chemistry: Chemistry, engine: Engine) -> None:
        """See :meth:`chemage.AgeingMethod.check`."""
        if chemistry.interaction is None:
            return
        self.engine.check(True)
        if not self.engine.restart:
            raise InputError(
                f"ageing 'closure': engine {self.engine.kind!r} cannot give the states; use another engine"
            )
        if not engine.exact and engine != self.engine:
            raise InputError(
                f"ageing 'closure' tabulates with engine {self.engine.kind!r}, but the scene asks for the approximate "
                f"engine {engine.kind!r}; set the option engine of [ageing] to it, or choose an exact engine"
            )

    def expected(
        self, sites: float, kinetics: Mapping[str, float], replicas: int, interacting: bool = False
    ) -> dict[str, float]:
        """Memory and time of a curve; of sites that interact a range, as the table may have yet to be made."""
        curve = 0.02 + 1e-6 * sites
        found = {"cpu_seconds": curve, "bytes": 2e8 + 40.0 * sites}
        if interacting:
            most = curve + TABLE_SECONDS * (0.005 / self.accuracy) ** 2
            found |= {"cpu_seconds": math.sqrt(curve * most), "cpu_seconds_least": curve, "cpu_seconds_most": most}
        return found

    def age(self, request: AgeingRequest) -> AgedBonds:
        """See :meth:`chemage.AgeingMethod.age`."""
        chemistry, times = request.chemistry, request.hold_times
        contact = request.contact
        statistics = contact if isinstance(contact, ContactStatistics) else contact_statistics(contact, chemistry)
        per_area = _density(request)
        sites = np.array([chemistry.hydroxylation * statistics.contact_area * per_area])
        counts = statistics.area * per_area
        bonds = counts @ bonded_share(chemistry, request.temperature, times, statistics.pressure)
        error, notes, took = np.full(times.size, INDEPENDENT_ERROR), (), _table.Took()
        source = f"at most {100 * INDEPENDENT_ERROR:g} %, of the quadrature"
        if chemistry.interaction is not None and statistics.pressure.size:
            change, noise, notes, took = self._interaction(request, statistics, per_area)
            bonds = bonds + change
            relative = np.divide(noise, bonds, out=np.zeros_like(noise), where=bonds > 0)
            error = np.sqrt(relative**2 + RMS_ERROR**2)
            source = (
                f"standard error: {100 * RMS_ERROR:g} %, the rms measured on contacts that tuned nothing, and that of "
                "the table"
            )
        return AgedBonds(
            bonds=np.clip(bonds, 0.0, sites)[None],
            sites=sites,
            errors={"closure": error},
            error_sources={"closure": source},
            notes=notes,
            engine=self.engine.kind if chemistry.interaction is not None else "quadrature",
            plugins=took.plugins,
            approximate=took.approximate,
        )

    def _interaction(
        self, request: AgeingRequest, statistics: ContactStatistics, per_area: float
    ) -> tuple[np.ndarray, np.ndarray, tuple[str, ...], _table.Took]:
        """What the interaction changes: bonds of the contact and their standard error, (m,) each; notes; plugins."""
        assert request.chemistry.interaction is not None
        spacing = 1 / math.sqrt(per_area)
        setting = _table.Setting(
            request.chemistry.replace(bond_force=1.0, front_factor=1.0),
            self.engine,
            request.temperature,
            spacing,
            coordination(request.chemistry.interaction, spacing),  # pyright: ignore[reportArgumentType]
            _table.decades_of(request.hold_times),
            self.accuracy,
        )
        if setting.most == 0:
            return np.zeros(request.hold_times.size), np.zeros(request.hold_times.size), (), _table.Took()
        first, parts = _places(setting, _without_tail(statistics))
        needed = sorted({int(number) for offset in range(len(parts)) for number in np.unique(first + offset)})
        if len(needed) > MOST_NODES:
            raise InputError(
                f"ageing 'closure' would tabulate {len(needed)} pressures up to {statistics.pressure[-1]:.3g} GPa; "
                "the pressures of this contact are out of its range, leave out [ageing]"
            )
        took = _table.taking_part(setting)
        nodes, notes = self._nodes(setting, needed, took, request)
        rim = _rim_moments(statistics, per_area)
        # (nodes, 3): sites, and those moments of the missing neighbours, at each pressure of the table
        place = {number: k for k, number in enumerate(needed)}
        weights = np.zeros((len(needed), 3))
        for offset, part in enumerate(parts):
            which = np.array([place[int(number)] for number in first + offset])
            for moment in range(3):
                weights[:, moment] += np.bincount(which, part * rim[:, moment], len(needed))
        stack = {name: np.stack([getattr(nodes[number], name) for number in needed]) for name in _NAMES}
        # δ (1 − x²) + a (x − x²)
        inside, edge = weights[:, 0] - weights[:, 2], weights[:, 1] - weights[:, 2]
        change = inside @ stack["change"] + edge @ stack["rim"]
        variance = inside**2 @ stack["change_error"] ** 2 + edge**2 @ stack["rim_error"] ** 2
        at = _in_time(setting, request.hold_times)
        return at(change), at(np.sqrt(variance)), notes, took

    def _nodes(
        self, setting: _table.Setting, needed: list[int], took: _table.Took, request: AgeingRequest
    ) -> tuple[dict[int, _table.Node], tuple[str, ...]]:
        """The table at the pressures that are needed: known, read, or computed now and kept."""
        path = _keeping.path_of(setting, Path(self.folder) if self.folder else _keeping.cache_folder())
        name = path, repr(took)
        with _lock:
            known = dict(_tables.get(name, {}))
            missing = [number for number in needed if number not in known]
            if not missing:
                return known, ()
            kept, problem = _keeping.load(path, setting, took)
            known |= kept
            missing = [number for number in needed if number not in known]
            notes = [f"{problem}, so that the table of ageing 'closure' is computed again"] if problem else []
            if missing:
                known |= _table.compute(setting, missing, request.threads, request.progress)
                if problem := _keeping.keep(path, setting, took, known):
                    notes.append(problem)
            _tables[name] = known
            return known, tuple(notes)


_NAMES = ("change", "change_error", "rim", "rim_error")


def _density(request: AgeingRequest) -> float:
    """Sites per nm²."""
    if isinstance(request.contact, ContactStatistics):
        if isinstance(request.chemistry.site_density, str):
            raise InputError(
                'site_density = "pixel": a contact without a map has no pixels; give the sites per nm² in [chemistry]'
            )
        return float(request.chemistry.site_density)
    return 1 / request.chemistry.sites_of(request.contact).spacing ** 2


def _without_tail(statistics: ContactStatistics) -> np.ndarray:
    """The pressures, GPa, but for the highest ones, which few sites have; what they cost would be the same."""
    beyond = np.cumsum(statistics.area[::-1])[::-1] - statistics.area
    kept = beyond > TAIL * statistics.contact_area
    return np.minimum(statistics.pressure, statistics.pressure[min(np.count_nonzero(kept), kept.size - 1)])


def _places(setting: _table.Setting, pressure: np.ndarray) -> tuple[np.ndarray, list[np.ndarray]]:
    """The first node of each pressure, and the weights of this node and those after it."""
    if not setting.pressure_step:
        return np.zeros(pressure.size, np.int64), [np.ones(pressure.size)]
    place = pressure / setting.pressure_step
    # cubic, between the two nodes in the middle, and at the lower end between the first two
    first = np.maximum(np.floor(place).astype(np.int64) - 1, 0)
    x = place - first
    return first, [
        -(x - 1) * (x - 2) * (x - 3) / 6,
        x * (x - 2) * (x - 3) / 2,
        -x * (x - 1) * (x - 3) / 2,
        x * (x - 1) * (x - 2) / 6,
    ]


def _rim_moments(statistics: ContactStatistics, per_area: float) -> np.ndarray:
    """(classes, 3): sites of each class, and the sums of x and x² over them, x being the share that is missing."""
    counts = statistics.area * per_area
    if statistics.missing is None:
        zero = np.zeros_like(counts)
        return np.stack([counts, zero, zero], axis=1)
    most = max(statistics.missing.shape[1] - 1, 1)
    x = np.arange(statistics.missing.shape[1]) / most
    joint = statistics.missing * per_area
    return np.stack([counts, joint @ x, joint @ x**2], axis=1)


def _in_time(setting: _table.Setting, hold_times: np.ndarray):
    """Interpolation of a curve of the table in the logarithm of time, monotone between its times."""
    from scipy.interpolate import PchipInterpolator

    first = math.log10(setting.times[0])
    positive = np.maximum(np.log10(np.maximum(hold_times, 1e-300)), first)

    def at(curve: np.ndarray) -> np.ndarray:
        values = PchipInterpolator(np.log10(setting.times), curve)(np.minimum(positive, setting.decades[1]))
        return np.where(hold_times > 0, values, 0.0)

    return at
