"""Shares of a sweep: which points one of several processes computes, such as the third of sixteen shares."""

from __future__ import annotations

import heapq
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass

from chemage.foundation.container import read_json, sealed_json
from chemage.foundation.errors import DamagedError, InputError
from chemage.studies.folder import Folder
from chemage.studies.study import Selection, in_ranges
from chemage.studies.sweeps.grid import Survey, cpu_seconds
from chemage.studies.tasks import Task, by_contact

#: the folder of divisions within that of a sweep
PLACE = ".shares"
_FILE = re.compile(r"of-(\d{1,7})\.json")


def points_of(
    selection: Selection | None, folder: Folder, survey: Survey
) -> Sequence[int]:
    """The numbers of the points of a sweep that a process computes, ascending; of means all, of which each share
    computes a part of the samples.

    Raises
    ------
    InputError
        The sweep has no such point.
    """
    count = len(survey.tasks)
    share = None if selection is None else selection.share
    if selection is None or (survey.means and share is not None):
        return range(count)
    if (
        share is None
        or read_partition(folder, share[1], survey.digest, count) is not None
    ):
        return agreed_points(selection, folder, survey.digest, count)
    return [
        point for point, of in enumerate(partition(survey, share[1])) if of == share[0]
    ]


def agreed_points(
    selection: Selection, folder: Folder, digest: str, count: int
) -> list[int]:
    """The same of the sweep of ``count`` points that is in ``folder``.

    Raises
    ------
    InputError
        The sweep has no such point.
    """
    if selection.share is not None:
        of = read_partition(folder, selection.share[1], digest, count) or ()
        return [point for point, share in enumerate(of) if share == selection.share[0]]
    last = max(last for _, last in selection.ranges)
    if last >= count:
        raise InputError(
            f"there is no point {last}: the sweep has points 0 to {count - 1}"
        )
    return sorted(
        {point for first, last in selection.ranges for point in range(first, last + 1)}
    )


# -- division of all points --------------------------------------------------------------------------------------------


def partition(survey: Survey, count: int) -> list[int]:
    """Divide the points of a sweep into shares of about equal CPU time.

    Points with the same kinetics stay together, and points with one contact do unless shares become more equal if they
    are divided. The longest pieces are dealt first, each to the share that has least. Where a component gives no
    estimate, each contact and each point counts the same.

    Parameters
    ----------
    survey
        The points.
    count
        Number of shares. With more shares than groups of points some shares are empty.

    Returns
    -------
    list of int
        For each point the number of its share, 1 to ``count``.
    """
    best: tuple[float, list[int]] = (math.inf, [])
    for finer in (1, 2, 4):
        longest, of = _dealt(_pieces(survey, count * finer), count, len(survey.tasks))
        if longest < 0.95 * best[0]:
            best = longest, of
    return best[1]


def _dealt(
    pieces: Sequence[tuple[float, Sequence[int]]], count: int, points: int
) -> tuple[float, list[int]]:
    """Deal pieces, each with its cost and its points, to shares: the longest time of a share, s, and for each point
    its share."""
    loads = [(0.0, share) for share in range(1, count + 1)]
    of = [0] * points
    for cost, together in sorted(pieces, key=lambda piece: -piece[0]):
        load, share = loads[0]
        for point in together:
            of[point] = share
        heapq.heapreplace(loads, (load + cost, share))
    return max(loads)[0], of


def _pieces(survey: Survey, count: int) -> list[tuple[float, list[int]]]:
    """The cost and the points of groups of points with one contact, none longer than a ``count``-th of all where it can
    be divided."""
    is_known = cpu_seconds(survey.tasks) is not None

    def seconds(estimate: float) -> float:
        return estimate + 1e-3 if is_known else 1.0

    groups = []
    for ageings in by_contact(survey.tasks):
        kinetics = [seconds(tasks[0].ageing_seconds) for tasks in ageings]
        groups.append((ageings, seconds(ageings[0][0].contact_seconds), kinetics))
    total = sum(contact + sum(kinetics) for _, contact, kinetics in groups)
    pieces = []
    for ageings, contact, kinetics in groups:
        whole = contact + sum(kinetics)
        parts = min(len(ageings), max(1, math.ceil(whole * count / total - 1e-9)))
        for part in range(parts):
            chosen = slice(
                part * len(ageings) // parts, (part + 1) * len(ageings) // parts
            )
            points = [task.number for tasks in ageings[chosen] for task in tasks]
            # each process solves the contact, rather than wait for another one
            pieces.append((contact + sum(kinetics[chosen]), points))
    return pieces


@dataclass(frozen=True)
class ShareCost:
    """The estimated cost of one share."""

    points: int
    #: contacts that the points need, which other shares may need as well
    contacts: int
    #: CPU time, s, if it solves all these contacts; None if a component gives no estimate
    cpu_seconds: float | None


def shares_cost(survey: Survey, count: int) -> list[ShareCost]:
    """The estimated cost of each of ``count`` shares."""
    shares: list[list[Task]] = [[] for _ in range(count)]
    for task, share in zip(survey.tasks, partition(survey, count), strict=True):
        shares[share - 1].append(task)
    return [
        ShareCost(len(tasks), len({task.contact for task in tasks}), cpu_seconds(tasks))
        for tasks in shares
    ]


# -- the division that processes agreed on ----------------------------------------------------------------------------


def read_partition(
    folder: Folder, count: int, digest: str, points: int
) -> list[int] | None:
    """The division of the ``points`` points of a sweep into ``count`` shares, if it is in the folder."""
    try:
        content = read_json(folder.path / PLACE / f"of-{count}.json")
    except (OSError, DamagedError):
        return None
    of = content.get("shares")
    if not (
        content.get("digest") == digest and isinstance(of, list) and len(of) == points
    ):
        return None
    return (
        of if all(type(share) is int and 1 <= share <= count for share in of) else None
    )


def agree(folder: Folder, survey: Survey, count: int) -> None:
    """Write a division of the points into ``count`` shares, unless another process has.

    Estimates of cost may differ between machines; all processes use the division of the first one.
    """

    def there() -> bool:
        return (
            read_partition(folder, count, survey.digest, len(survey.tasks)) is not None
        )

    if not there():
        path = folder.path / PLACE / f"of-{count}.json"
        path.parent.mkdir(parents=True, exist_ok=True)
        content = sealed_json(
            {"digest": survey.digest, "shares": partition(survey, count)}
        )
        if not folder.place(path, content, over=False) and not there():
            folder.place(
                path, content
            )  # it was damaged, or that of a sweep that was replaced


def remedies(
    folder: Folder, points: Sequence[int], digest: str, count: int
) -> list[str]:
    """Selections of which each computes a part of ``points``, and the last all of them.

    These are shares, if processes have divided this sweep of ``count`` points once; and numbers of points.
    """
    texts = [in_ranges(points)] if points else []
    names = [_FILE.fullmatch(path.name) for path in (folder.path / PLACE).glob("of-*")]
    divisions = [int(match[1]) for match in names if match is not None]
    of = (
        read_partition(folder, divisions[0], digest, count)
        if len(divisions) == 1
        else None
    )
    if of is not None:
        texts = [
            f"{share}/{divisions[0]}"
            for share in sorted({of[point] for point in points})
        ] + texts
    return texts
