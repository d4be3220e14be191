"""What an ensemble learns from a map of speed against accuracy: measured costs and errors instead of estimated ones."""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from chemage.scene.files import override
from chemage.scene.parsing import parse_scene
from chemage.scene.scene import Scene
from chemage.studies.ensembles.computations import Computation, bare, estimated
from chemage.studies.ensembles.quantities import Quantities
from chemage.studies.trade.choices import GRID
from chemage.studies.trade.trade_map import LIMIT, Point, TradeMap

#: other settings are used where they are expected to cost at most this part of what those of the scene do
PAYS = 0.9
#: a budget is divided among so many processors at least, s of CPU time per s
_ONE = 1.0


@dataclass(frozen=True)
class Wanted:
    """What the settings are chosen for: quantities with their accuracy, or one quantity in a time."""

    #: (column, relative half width) of each goal; 0: as accurate as the time allows
    goals: Sequence[tuple[int, float]]
    #: CPU seconds; inf: as long as it takes
    budget: float = math.inf


def computations(found: TradeMap, scene: Scene, quantities: Quantities, wanted: Wanted) -> list[Computation]:
    """The settings of the map with which ``scene`` is expected to reach what is ``wanted`` at the least cost, and those
    of the scene itself last; only these where no other pay."""
    base, own = bare(scene), found.own
    if own is None:
        return []
    whole = _computation(base, own, found, quantities, errors=False)
    names = _names(quantities)
    least, chosen = PAYS * _price(own, own, found, names, wanted), None
    for point in found.points:
        if point.own or point.reference:
            continue
        price = _price(point, own, found, names, wanted)
        if price < least:
            least, chosen = price, point
    if chosen is None:
        return [whole]
    changed = parse_scene(override(base.todict(), chosen.changes))
    # what the material gave is written out in the data
    changed = changed.model_copy(update={"material": base.material, "from_material": base.from_material})
    return [_computation(changed, chosen, found, quantities), whole]


def _computation(
    scene: Scene, point: Point, found: TradeMap, quantities: Quantities, errors: bool = True
) -> Computation:
    ageing = statistics.median(point.ageing_seconds)
    known = scene.surface.expected().get("pixel_size", 0.0)
    own = found.scene.get("surface", {}).get("pixel_size", known)
    factor = round(known / own) if isinstance(own, int | float) and own > 0 and known else 1
    return replace(
        estimated(scene, factor),
        contact_seconds=statistics.median(point.contact_seconds),
        replica_seconds=ageing / found.replicas if point.replicates and found.replicas else ageing,
        settings="" if point.own else point.words,
        errors=_errors(point, quantities) if errors else None,
        grid_only=set(point.choices) <= {GRID},
        timed=True,
    )


def _names(quantities: Quantities) -> list[str]:
    """The name of every column in a map."""
    curve = [f"friction_drop@{time:g} s" for time in quantities.hold_times.tolist()]
    return [*(["beta"] if quantities.has_beta else []), *curve, *quantities.measures]


def _errors(point: Point, quantities: Quantities) -> np.ndarray:
    """(quantities,) relative standard errors of the settings; nan where they were not measured."""
    names = _names(quantities)
    if point.exact:
        return np.zeros(len(names))
    return np.array([point.deviation(name).size for name in names])


def _price(point: Point, own: Point, found: TradeMap, names: list[str], wanted: Wanted) -> float:
    """CPU seconds until every goal is reached, with or without corrections; with a budget alone, the relative half
    width that it allows."""
    return max(_price_of(point, own, found, names[column], accuracy, wanted) for column, accuracy in wanted.goals)


def _price_of(point: Point, own: Point, found: TradeMap, name: str, accuracy: float, wanted: Wanted) -> float:
    seconds, whole = _of_one(point, found), _of_one(own, found)
    surfaces = found.surface_scatter.get(name, 0.0) if found.random else 0.0
    variance = surfaces**2 + point.scatter.get(name, 0.0) ** 2
    same = point.own or point.exact
    size = 0.0 if same else point.deviation(name).size
    if math.isnan(size) or math.isnan(variance):
        return math.inf
    one = point.deviation(name)
    # on random surfaces of the mean over the replicas of a round, as a correction has several replicas
    change = 0.0 if same else one.stderr**2 * (found.rounds if found.random else one.freedom + 1)
    corrected = (math.sqrt(variance * seconds) + math.sqrt(change * (seconds + whole))) ** 2
    if accuracy == 0:
        time = wanted.budget if math.isfinite(wanted.budget) else _ONE
        return LIMIT * min(math.sqrt(variance * seconds / time + size**2), math.sqrt(corrected / time))
    left = (accuracy / LIMIT) ** 2 - size**2
    plain = seconds * variance / left if left > 0 else math.inf
    return min(plain, corrected * (LIMIT / accuracy) ** 2)


def _of_one(point: Point, found: TradeMap) -> float:
    """CPU seconds of one surface with one replica."""
    ageing = statistics.median(point.ageing_seconds)
    if point.replicates and found.replicas:
        ageing /= found.replicas
    return statistics.median(point.contact_seconds) + ageing


def own_error(found: TradeMap, quantities: Quantities) -> str:
    """How far the scene's own settings are from the reference of the map, in words; "" where it is not known."""
    names = _names(quantities)
    if found.own is None or not names:
        return ""
    one = found.own.deviation(names[0])
    if math.isnan(one.half_width):
        return ""
    text = f"{100 * one.value:.2g} ± {100 * one.half_width:.2g} %"
    return (
        f"with the settings of the scene {names[0].replace('_', ' ')} differs from that of the most accurate ones by "
        f"{text}, as measured for the map"
    )
