"""Runs the tasks of a study on an executor: those of one contact together, so that it is solved once."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, CancelledError, Future, wait
from dataclasses import dataclass, field
from itertools import pairwise

from chemage.foundation.errors import ExecutorError, WorkerLost
from chemage.foundation.memory import capacity
from chemage.studies.folder import RESUME, Folder
from chemage.studies.runner import Pool
from chemage.studies.tasks import RETRIES, Answer, Known, Outcome, Place, Task, compute, failure

#: called in this thread with each task as it ends
Told = Callable[[Task, Outcome], None]
#: seconds between two reports of the progress
PERIOD = 0.2
#: memory of the program itself, bytes
PROGRAM = 2e8


@dataclass
class Piece:
    """Tasks that one worker computes in one call: all have one contact."""

    tasks: list[Task]
    #: whether the contact must be solved
    solves: bool
    #: estimated CPU time, s; nan where it is not known
    weight: float
    #: whether nothing else runs at the same time, so that a worker that dies must have died of this piece
    alone: bool = False
    #: how often a worker died of it while nothing else ran
    deaths: int = 0


class Runner:
    """Runs tasks on the workers of ``pool``.

    Parameters
    ----------
    pool
        The executor.
    place
        The folder in which results are kept; None: they are handed to the caller.
    known
        Components and plugins that are registered by hand, for workers in other processes.
    watch
        Called several times a second while tasks run, with this runner.
    """

    def __init__(
        self, pool: Pool, place: Place | None, known: Known = (), watch: Callable[[Runner], None] | None = None
    ) -> None:
        self._pool, self._place, self._known, self._watch = pool, place, known, watch
        self._ready: deque[Piece] = deque()
        #: contacts that must be solved: pieces that wait for them, the one that solves it first
        self._contacts: deque[list[Piece]] = deque()
        self._behind: dict[str, list[Piece]] = {}
        self._running: dict[Future[Answer], Piece] = {}
        self._suspects: deque[Piece] = deque()
        self._clock = _Clock()
        memory = capacity() if pool.here else None
        self._memory = math.inf if memory is None else memory - PROGRAM

    @property
    def _whole(self) -> Folder | None:
        """The folder, if contacts and failures are kept there as well."""
        return self._place.folder if self._place is not None and self._place.contacts else None

    @property
    def unsolved(self) -> int:
        """Contacts that are still to be solved."""
        return len(self._contacts) + len(self._behind)

    @property
    def width(self) -> int:
        """Present number of concurrent pieces."""
        return self._pool.width()

    def run(self, tasks: Iterable[Task], told: Told) -> None:
        """Compute ``tasks``, and call ``told`` with each as it ends, in any order.

        Raises
        ------
        ExecutorError
            The workers cannot be started, or have ended.
        """
        self._divide(list(tasks))
        reported = 0.0
        try:
            while self._ready or self._contacts or self._running or self._suspects:
                self._submit()
                finished, _ = wait(self._running, timeout=0.5, return_when=FIRST_COMPLETED)
                for future in finished:
                    self._settle(self._running.pop(future), future, told)
                now = time.perf_counter()
                if self._watch is not None and now > reported + PERIOD:
                    reported = now
                    self._watch(self)
            if self._watch is not None:
                self._watch(self)
        except BaseException:
            for future in self._running:
                future.cancel()
            self._running.clear()
            self._pool.abort()
            raise

    def remaining(self) -> float | None:
        """Estimated wall time of what is left, s; None before the first piece has ended."""
        waiting = [*self._ready, *(piece for pieces in (*self._contacts, *self._behind.values()) for piece in pieces)]
        weights = [piece.weight for piece in waiting]
        weights += [piece.weight / 2 for piece in (*self._running.values(), *self._suspects)]
        return self._clock.remaining(weights, self.width)

    # -- pieces -------------------------------------------------------------------------------------------------------

    def _divide(self, tasks: Sequence[Task]) -> None:
        """Divide tasks into pieces, in an order in which successive contacts share a surface."""
        groups: dict[str, dict[str, dict[str, list[Task]]]] = {}
        for task in tasks:
            ageings = groups.setdefault(task.surface, {}).setdefault(task.contact, {})
            ageings.setdefault(task.ageing, []).append(task)
        for contacts in groups.values():
            for ageings in contacts.values():
                self._divide_contact(list(ageings.values()))

    def _divide_contact(self, ageings: list[list[Task]]) -> None:
        first = ageings[0][0]
        folder = self._whole
        there = folder is not None and folder.has_contact(first.contact)
        if folder is None:
            ageings = self._joined(ageings)
        pieces = [Piece(tasks, False, _seconds(tasks)) for tasks in ageings]
        if there:
            self._ready.extend(pieces)
            return
        pieces[0].solves = True
        pieces[0].weight += first.contact_seconds
        self._contacts.append(pieces)

    def _joined(self, ageings: list[list[Task]]) -> list[list[Task]]:
        """Ageings of a contact that is not kept, in so many pieces as it pays to solve the contact for."""
        contact = ageings[0][0].contact_seconds
        total = sum(map(_seconds, ageings))
        count = len(ageings)
        if math.isfinite(contact + total):
            count = max(1, min(count, 4 * self.width, math.ceil(total / max(contact, 1e-9))))
        edges = [k * len(ageings) // count for k in range(count + 1)]
        return [[task for ageing in ageings[begin:end] for task in ageing] for begin, end in pairwise(edges)]

    def _submit(self) -> None:
        width = self.width
        if self._suspects and not self._running and not self._ready and not self._contacts:
            piece = self._suspects.popleft()
            piece.alone = True
            self._start(piece)
        while len(self._running) < width and self._fits():
            if any(piece.alone for piece in self._running.values()):
                break
            # pieces whose contact is there come first, while a worker still has it in memory; but half of the workers
            # solve contacts, so that the last contact does not begin after everything else has ended
            solving = sum(piece.solves for piece in self._running.values())
            if self._contacts and (not self._ready or solving < width // 2):
                piece, *behind = self._contacts.popleft()
                self._behind[piece.tasks[0].contact] = behind
            elif self._ready:
                piece = self._ready.popleft()
            else:
                break
            self._start(piece)

    def _fits(self) -> bool:
        """Whether the memory of this machine holds one more piece like those that run."""
        sizes = [max(task.bytes for task in piece.tasks) for piece in self._running.values()]
        return not sizes or sum(sizes) + max(sizes) <= self._memory

    def _start(self, piece: Piece) -> None:
        remote = self._pool.remote
        tasks = [task.loaded() for task in piece.tasks] if remote else piece.tasks
        future = self._pool.submit(compute, self._place, tasks, self._pool.threads, self._known, remote)
        self._running[future] = piece

    # -- what comes of them -------------------------------------------------------------------------------------------

    def _settle(self, piece: Piece, future: Future[Answer], told: Told) -> None:
        try:
            answer = future.result()
        except WorkerLost as error:
            piece.deaths += piece.alone
            if piece.deaths <= (RETRIES if piece.alone else 0):
                self._suspects.append(piece)  # perhaps it only ran beside the piece that killed the worker
                return
            answer = self._lost(piece, error)
        except (BrokenExecutor, CancelledError) as error:
            raise ExecutorError(f"the executor gave up ({type(error).__name__}: {error}); {RESUME}") from error
        except ExecutorError as error:
            raise ExecutorError(f"{error}; {RESUME}") from error
        else:
            self._clock.add(piece.weight, answer.seconds)
        for task in piece.tasks:
            told(task, answer.outcomes[task.key])
        if piece.solves:
            self._after_contact(piece, answer, told)

    def _after_contact(self, piece: Piece, answer: Answer, told: Told) -> None:
        """Let those begin that waited for a contact; if it cannot be solved, they fail as well."""
        behind = self._behind.pop(piece.tasks[0].contact)
        outcome = answer.outcomes[piece.tasks[0].key]
        if outcome.error is None or outcome.stage != "contact":
            self._ready.extend(behind)
            return
        for task in (task for other in behind for task in other.tasks):
            self._record(task, outcome)
            told(task, outcome)

    def _lost(self, piece: Piece, error: WorkerLost) -> Answer:
        """What is known of tasks whose worker died each time."""
        there = self._whole is not None and self._whole.has_contact(piece.tasks[0].contact)
        outcome = Outcome(error=error, stage="ageing" if there or not piece.solves else "contact")
        for task in piece.tasks:
            self._record(task, outcome)
        return Answer(outcomes=dict.fromkeys((task.key for task in piece.tasks), outcome))

    def _record(self, task: Task, outcome: Outcome) -> None:
        """Write that a task failed, which no worker could."""
        if self._whole is not None and outcome.error is not None:
            self._whole.write_point(task.key, failure(task.number, task.changes, outcome.stage, outcome.error))


def _seconds(tasks: Sequence[Task]) -> float:
    """Estimated CPU time of the ageings of tasks, s; the same ageing counts once."""
    return sum({task.ageing: task.ageing_seconds for task in tasks}.values()) + 1e-3


@dataclass
class _Clock:
    """Estimates the remaining time from the duration of the pieces that have ended."""

    seconds: float = 0.0
    weight: float = 0.0
    count: int = 0
    #: whether every weight is known
    known: bool = field(default=True)

    def add(self, weight: float, seconds: float) -> None:
        self.seconds += seconds
        self.count += 1
        self.known = self.known and math.isfinite(weight)
        self.weight += weight if math.isfinite(weight) else 0.0

    def remaining(self, weights: Sequence[float], width: int) -> float | None:
        if not self.count:
            return None
        total = sum(weights)
        if self.known and math.isfinite(total) and self.weight > 0:
            return self.seconds / self.weight * total / max(1, width)
        return self.seconds / self.count * len(weights) / max(1, width)
