"""One dimension for each axis of a sweep: their names, and the coordinates along them."""

from __future__ import annotations

from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from chemage.studies.sweeps.grid import Axis

#: names that the dataset of a sweep has anyway, beside those of the results
RESERVED = ("point", "status", "error", "approximate", "beta_reason", "hold_time", "hold_times", "replica", "bonds")


@dataclass(frozen=True)
class Dimension:
    """The dimension of one axis; lines that vary together share one."""

    #: name of one of the fields, see :func:`dimensions`
    name: str
    #: swept path -> name of its coordinate
    coordinates: Mapping[str, str]
    size: int


def short_names(
    paths: Sequence[str], taken: Container[str] = (), units: Mapping[str, str] | None = None
) -> dict[str, str]:
    """The name of each swept path: its last part (``contact.load`` is ``load``, ``engine.kind`` is ``engine``); loads
    that are given as pressures (``units`` are those of the paths) are ``nominal_pressure``.

    It is all of the path with underscores (``surface_seed``) where two would have one name, or a result has it already
    (``taken``).
    """
    last = {path: last_part(path) for path in paths}
    if units is not None and units.get("contact.load") == "GPa" and "contact.load" in last:
        last["contact.load"] = "nominal_pressure"
    found = {}
    for path, name in last.items():
        clear = list(last.values()).count(name) == 1 and name not in taken and name not in RESERVED
        found[path] = name if clear else path.replace(".", "_").replace("/", "_")
    return found


def last_part(path: str) -> str:
    """The last part of a path, without ``kind``."""
    parts = path.split(".")
    return parts[-2] if parts[-1] == "kind" and len(parts) > 1 else parts[-1]


def is_seed(path: str) -> bool:
    """Whether a swept field only chooses random numbers."""
    return path.rpartition(".")[2] == "seed"


def dimensions(
    axes: Sequence[Axis],
    values: Mapping[str, Sequence[Any]],
    taken: Container[str] = (),
    units: Mapping[str, str] | None = None,
) -> tuple[Dimension, ...]:
    """The dimensions of a sweep with ``axes``, whose paths have ``values`` at the points, in ``units``.

    A dimension has the name of its field; of several that vary together, that of the first whose values all differ and
    that is no seed, if there is one.
    """
    names = short_names([path for axis in axes for path in axis.paths], taken, units)
    found = []
    for axis in axes:
        distinct = [path for path in axis.paths if len({str(value) for value in values[path]}) == len(axis)]
        fields = [path for path in distinct if not is_seed(path)]
        leading = [*fields, *distinct, *axis.paths][0]
        found.append(Dimension(names[leading], {path: names[path] for path in axis.paths}, len(axis)))
    return tuple(found)
