"""The number of bonds from the statistics of a contact, without the kinetics of its sites."""

from __future__ import annotations

import math
import threading
from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar

import numpy as np
from pydantic import Field

from chemage import Chemistry, ContactSolution, InputError
from chemage.plugin import (
    AgedBonds,
    AgeingMethod,
    AgeingRequest,
    Choice,
    ContactStatistics,
    Engine,
    build_lattice,
    cache_folder,
    contact_statistics,
    coordination,
)
from chemage_ageing import _table
from chemage_ageing._table import bonded_share, cubic

#: largest relative error of the mean number of bonds on 136 contacts from 50 to 600 K and up to 20 GPa, on 24 sites
#: under a tip at 137 K (``tests/benchmarks/closure_errors.py --wide``)
LARGEST_ERROR = 0.14
#: standard error of the approximation: of the most that the interaction has changed at the rim until then, weighted by
#: the square of the share of neighbours that are missing, as the others lack neighbours as well; of what unequal
#: pressures change. Most likely values for 35 contacts from 50 to 600 K and up to 20 GPa, none of which is among those
#: of the validation (``tests/benchmarks/closure_errors.py --wide``)
RIM_ERROR, UNEVEN_ERROR = 0.145, 0.13
#: relative error of sites that do not interact: the quadrature
INDEPENDENT_ERROR = 2e-4
#: CPU seconds of a pressure of a table at the default accuracy, at most, measured from 120 to 570 K, most where bonds
#: break and form until they settle; of coarser ones at least so much of that
NODE_SECONDS, COARSE_SHARE = 15.0, 0.5
#: the most pressures of a table where the contact is not known
USUAL_NODES = 25
#: of the share of the sites under the highest pressures, the change is taken at the pressure at which they begin
TAIL = 1e-6
#: the most pressures of a table
MOST_NODES = 4000
#: effective neighbours beyond those of a site inside a contact, over their number
BEYOND = (2.0, 4.0, 8.0, 16.0, 32.0, 64.0, 128.0, 256.0)
#: sites of a contact whose neighbours are looked at; of a larger one so many, evenly over the pressures
SITES = 65_536
#: sites that are treated at the same time
CHUNK = 8192

_lock = threading.Lock()
#: file, and what took part in the table -> its nodes
_tables: dict[tuple[Path, str], dict[int, _table.Node]] = {}


class Closure(AgeingMethod):
    """Bonds per area as a function of pressure, neighbours and time, summed over the statistics of the contact.

    A site under the pressure p with n effective neighbours is bonded with the probability ρ₀(p, t) [1 + g(p, n, t)]: ρ₀
    of a site that does not interact, exactly; g, by which the interaction changes it, from the kinetics of contacts
    under one pressure from which sites are missing at random. A neighbour under another pressure q counts as
    ρ₀(q, t)/ρ₀(p, t) neighbours. g is tabulated once for each chemistry and temperature and kept in the cache folder of
    the user. It gives the mean number of bonds: no replicas, no scatter, no states.
    """

    kind = "closure"
    exact: ClassVar[bool] = False
    declared_error: ClassVar[float | None] = LARGEST_ERROR
    replicates: ClassVar[bool] = False
    needs_map: ClassVar[bool] = False
    speed_only: ClassVar[tuple[str, ...]] = ("folder",)
    trade: ClassVar[Mapping[str, tuple[float, ...]]] = {
        "accuracy": (0.02, 0.01, 0.005)
    }

    accuracy: float = Field(default=0.01, ge=1e-4, le=0.2)
    """relative standard error of the table, at each of its pressures and at each decade of time"""
    engine: Choice[Engine] = Field(default="next-reaction", validate_default=True)
    """engine of the table; it must be able to give the states of the sites"""
    folder: str = ""
    """folder in which tables are kept; default: the cache folder of the user"""

    def check(self, chemistry: Chemistry, engine: Engine) -> None:
        """See :meth:`chemage.plugin.AgeingMethod.check`."""
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
        self,
        sites: float,
        kinetics: Mapping[str, float],
        replicas: int,
        interacting: bool = False,
        chemistry: Chemistry | None = None,
        temperature: float = 300.0,
        mean_pressure: float | None = None,
    ) -> dict[str, float]:
        """Memory and time of a curve; of sites that interact a range, as the table may have yet to be made."""
        curve = 0.02 + 1e-6 * sites
        cost = {"cpu_seconds": curve, "bytes": 3e7 + 40.0 * sites}
        if interacting:
            nodes = USUAL_NODES
            if chemistry is not None and mean_pressure is not None:
                # a rough contact has the highest pressures
                highest = mean_pressure * math.sqrt(-4 / math.pi * math.log(TAIL))
                step = _table.pressure_step(chemistry, temperature)
                nodes = 4 + int(highest / step) if step else 1
            most = curve + nodes * NODE_SECONDS * max(
                (0.01 / self.accuracy) ** 2, COARSE_SHARE
            )
            cost |= {
                "cpu_seconds": math.sqrt(curve * most),
                "cpu_seconds_least": curve,
                "cpu_seconds_most": most,
            }
        return cost

    def age(self, request: AgeingRequest) -> AgedBonds:
        """See :meth:`chemage.plugin.AgeingMethod.age`."""
        chemistry, times = request.chemistry, request.hold_times
        statistics = contact_statistics(request.contact, chemistry)
        per_area = chemistry.sites_per_area(request.contact)
        sites = np.array(
            [chemistry.hydroxylation * statistics.contact_area * per_area]
        )
        independent = bonded_share(
            chemistry, request.temperature, times, statistics.pressure
        )
        bonds = np.einsum("c,cm->m", statistics.area * per_area, independent)
        error, notes, took = (
            np.full(times.size, INDEPENDENT_ERROR),
            (),
            _table.Took(),
        )
        source = f"at most {100 * INDEPENDENT_ERROR:g} %, of the quadrature"
        if chemistry.interaction is not None and statistics.pressure.size:
            changed, absolute, notes, took = self._interaction(
                request, statistics, per_area, independent
            )
            bonds = bonds + changed
            relative = np.divide(
                absolute, bonds, out=np.zeros_like(absolute), where=bonds > 0
            )
            error = np.hypot(relative, INDEPENDENT_ERROR)
            source = "standard error: that of the table, and of the approximation, from the rim and the pressures"
        return AgedBonds(
            # a mean, so that the bounds bring it nearer to the truth, by less than its error
            bonds=np.clip(bonds, 0.0, sites)[None],
            sites=sites,
            errors={"closure": error},
            error_sources={"closure": source},
            notes=notes,
            engine=self.engine.kind
            if chemistry.interaction is not None
            else "quadrature",
            plugins=took.plugins,
            approximate=took.approximate,
        )

    def _interaction(
        self,
        request: AgeingRequest,
        statistics: ContactStatistics,
        per_area: float,
        independent: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray, tuple[str, ...], _table.Took]:
        """What the interaction changes of the bonds, (m,), and the error of that; notes; plugins. ``independent``:
        (classes, m) without interaction."""
        assert request.chemistry.interaction is not None
        spacing = 1 / math.sqrt(per_area)
        setting = _table.Setting(
            request.chemistry.replace(bond_force=1.0, front_factor=1.0),
            self.engine,
            request.temperature,
            spacing,
            coordination(request.chemistry.interaction, spacing),  # pyright: ignore[reportArgumentType]
            _table.decades_of(
                request.hold_times, request.chemistry, request.temperature
            ),
            self.accuracy,
        )
        if setting.most == 0:
            zero = np.zeros(request.hold_times.size)
            return zero, zero, (), _table.Took()
        # the highest pressures, which few sites have, count as those before them: what they cost would be the same
        beyond = np.cumsum(statistics.area[::-1])[::-1] - statistics.area
        kept = np.count_nonzero(beyond > TAIL * statistics.contact_area)
        pressure = np.minimum(
            statistics.pressure,
            statistics.pressure[min(kept, statistics.area.size - 1)],
        )
        first, parts = np.zeros(pressure.size, np.int64), [np.ones(pressure.size)]
        if setting.pressure_step:
            first, parts = cubic(pressure / setting.pressure_step, lowest=0)
        needed = sorted(
            {
                int(number)
                for offset in range(len(parts))
                for number in np.unique(first + offset)
            }
        )
        if len(needed) > MOST_NODES:
            raise InputError(
                f"ageing 'closure' would tabulate {len(needed)} pressures up to {statistics.pressure[-1]:.3g} GPa; "
                "the pressures of this contact are out of its range, leave out [ageing]"
            )
        took = setting.taking_part()
        nodes, notes = self._nodes(setting, needed, took, request)
        tabulated = [
            np.stack([getattr(nodes[number], name) for number in needed])
            for name in ("change", "error")
        ]
        # an error in bonds that formed early stays when the interaction changes little any more
        tabulated.append(np.maximum.accumulate(np.abs(tabulated[0]), axis=-1))
        change, error, largest = (
            _in_time(setting, request.hold_times, values) for values in tabulated
        )
        # (classes, nodes): the part of each node of the table in the pressure of each class
        part = np.zeros((first.size, len(needed)))
        for offset, weight in enumerate(parts):
            np.add.at(
                part,
                (np.arange(first.size), np.searchsorted(needed, first + offset)),
                weight,
            )
        if request.contact.has_map:
            present, effective = _rim_of_map(
                request.solution,
                request.chemistry,
                statistics,
                independent,
                setting.most,
            )
        else:
            present = _rim_of_statistics(statistics, per_area, setting.most)
            effective = (
                np.zeros((*present.shape, request.hold_times.size))
                + present[..., None]
            )
            effective = np.pad(effective, ((0, 0), (0, len(BEYOND)), (0, 0)))
        sites = present, effective, independent, largest
        bonds, absolute = _changed(part, change, np.abs(error), *sites)
        beyond, before = _settled(setting, request.hold_times, tabulated[0])
        if beyond.any():
            drift = bonds - _changed(part, before, np.abs(error), *sites)[0]
            absolute = np.hypot(absolute, drift * beyond)
        return bonds, absolute, notes, took

    def _nodes(
        self,
        setting: _table.Setting,
        needed: list[int],
        took: _table.Took,
        request: AgeingRequest,
    ) -> tuple[dict[int, _table.Node], tuple[str, ...]]:
        """The table at the pressures that are needed: known, read, or computed now and kept."""
        path = setting.path(Path(self.folder) if self.folder else cache_folder())
        name = path, repr(took)
        with _lock:
            nodes = dict(_tables.get(name, {}))
            if nodes.keys() >= set(needed):
                return nodes, ()
            kept, problem = setting.load(path, took)
            nodes |= kept
            missing = [number for number in needed if number not in nodes]
            notes = (
                [
                    f"{problem}, so that the table of ageing 'closure' is computed again"
                ]
                if problem
                else []
            )
            if missing:
                nodes |= setting.nodes(missing, request.threads, request.progress)
                if problem := setting.keep(path, took, nodes):
                    notes.append(problem)
            _tables[name] = nodes
            return nodes, tuple(notes)


def _changed(
    part: np.ndarray,
    change: np.ndarray,
    error: np.ndarray,
    present: np.ndarray,
    effective: np.ndarray,
    independent: np.ndarray,
    largest: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """The change of all sites from that of each number of neighbours, (m,), and its standard error: that of the table,
    and that of the approximation.

    ``part`` (classes, nodes); ``change`` and ``error`` (nodes, neighbours + 1, m); ``present`` (classes, neighbours
    + 1): sites with so many neighbours; ``effective`` (classes, columns, m): sites with so many effective neighbours,
    see :data:`BEYOND`; ``independent`` (classes, m); ``largest``, like ``change``: its largest magnitude until then.
    """
    most = change.shape[1] - 1
    inside = change[:, -1]
    times = np.array(BEYOND)[:, None, None]
    # so many times the neighbours of a site inside: independent of each other if they block, added if they help
    blocked = np.maximum(1 + inside, 0.0) ** times
    further = np.where(inside < 0, blocked - 1, times * inside)
    slope = np.where(
        inside < 0, times * np.maximum(1 + inside, 1e-12) ** (times - 1), times
    )
    columns = np.concatenate([change, np.moveaxis(further, 0, 1)], axis=1)
    weights = np.einsum("ck,cjm->kjm", part, effective * independent[:, None])
    bonds = np.einsum("kjm,kjm->m", weights, columns)
    own = weights[:, : most + 1].copy()
    own[:, -1] += np.einsum("kjm,jkm->km", weights[:, most + 1 :], slope)
    table = np.sqrt(np.einsum("kjm,kjm->m", own**2, error**2))
    # (classes, neighbours + 1, m): what would change if neighbours were all under the pressure of the site
    alone = present[..., None] * independent[:, None]
    alike = np.einsum("ck,kjm->cjm", part, change) * alone
    lack = 1 - np.arange(most + 1) / most
    rim = np.einsum(
        "cjm,j->m", np.abs(np.einsum("ck,kjm->cjm", part, largest) * alone), lack**2
    )
    uneven = np.abs(
        alike.sum(axis=1)
        - np.einsum(
            "ck,cjm,kjm->cm", part, effective * independent[:, None], columns
        )
    ).sum(axis=0)
    return bonds, np.sqrt(
        table**2 + np.hypot(RIM_ERROR * rim, UNEVEN_ERROR * uneven) ** 2
    )


def _settled(
    setting: _table.Setting, hold_times: np.ndarray, change: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The decades of the hold times after the table, (m,), in which the change of its last one may go on; what was there
    before that decade."""
    last = setting.times[-1]
    # exactly 0 within the table
    beyond = np.log10(np.maximum(hold_times / last, 1.0))
    return beyond, _in_time(setting, np.minimum(hold_times, last / 10), change)


def _in_time(
    setting: _table.Setting, hold_times: np.ndarray, values: np.ndarray
) -> np.ndarray:
    """Values (..., times of the table) at the hold times: monotone interpolation in the logarithm of time."""
    from scipy.interpolate import PchipInterpolator

    first, last = setting.decades
    places = np.clip(np.log10(np.maximum(hold_times, 10.0**first)), first, last)
    return np.where(
        hold_times > 0,
        PchipInterpolator(np.log10(setting.times), values, axis=-1)(places),
        0.0,
    )


def _rim_of_statistics(
    statistics: ContactStatistics, per_area: float, most: int
) -> np.ndarray:
    """(classes, most + 1): sites of each class of pressure that have so many neighbours."""
    held = np.zeros((statistics.area.size, most + 1))
    if statistics.missing is None:
        held[:, most] = statistics.area * per_area
        return held
    lacking = np.minimum(np.arange(statistics.missing.shape[1]), most)
    np.add.at(held.T, most - lacking, statistics.missing.T * per_area)
    return held


def _rim_of_map(
    contact: ContactSolution,
    chemistry: Chemistry,
    statistics: ContactStatistics,
    independent: np.ndarray,
    most: int,
) -> tuple[np.ndarray, np.ndarray]:
    """Sites of each class of pressure that have so many neighbours, (classes, most + 1); and so many effective ones,
    (classes, most + 1 + beyond, m).

    A neighbour counts as the share of bonded sites without interaction under its pressure over that under the pressure
    of the site; ``independent``, (classes, m), are these shares. Between two whole numbers a site is divided.
    """
    lattice = build_lattice(chemistry.replace(hydroxylation=1.0), contact, 0)
    assert lattice.neighbours is not None
    pressure = np.asarray(chemistry.sites_of(contact).pressure, dtype=np.float64)
    between = 0.5 * (statistics.pressure[1:] + statistics.pressure[:-1])
    place = np.append(
        np.searchsorted(between, pressure), len(independent)
    )  # the last: no neighbour
    chosen = np.arange(pressure.size)
    if pressure.size > SITES:
        chosen = np.argsort(pressure, kind="stable")[
            ((np.arange(SITES) + 0.5) * (pressure.size / SITES)).astype(int)
        ]
    share = np.concatenate([independent, np.zeros((1, independent.shape[1]))])
    classes = len(independent)
    columns = np.concatenate([np.arange(most + 1.0), most * np.array(BEYOND)])
    present = np.zeros(classes * (most + 1))
    effective = np.zeros((classes * columns.size, independent.shape[1]))
    for begin in range(0, chosen.size, CHUNK):
        some = chosen[begin : begin + CHUNK]
        graph, own = lattice.neighbours[some], place[some]
        present += np.bincount(
            own * (most + 1)
            + np.minimum(np.count_nonzero(graph >= 0, axis=1), most),
            minlength=present.size,
        )
        around = place[graph]
        for time in range(independent.shape[1]):
            column = share[:, time]
            count = np.divide(
                column[around].sum(axis=1),
                column[own],
                out=np.zeros(own.size),
                where=column[own] > 0,
            )
            count = np.minimum(count, columns[-1])
            left = np.clip(
                np.searchsorted(columns, count, side="right") - 1,
                0,
                columns.size - 2,
            )
            right = (count - columns[left]) / (columns[left + 1] - columns[left])
            at = own * columns.size + left
            effective[:, time] += np.bincount(at, 1 - right, len(effective))
            effective[:, time] += np.bincount(at + 1, right, len(effective))
    scale = pressure.size / chosen.size
    return scale * present.reshape(classes, -1), scale * effective.reshape(
        classes, columns.size, -1
    )
