"""What a scene needs, held against what the machine has, before anything is computed."""

from __future__ import annotations

from chemage.ageing.age import kept_bytes
from chemage.foundation.errors import InputError, PlanWarning
from chemage.foundation.memory import require
from chemage.foundation.threads import available
from chemage.lattices.site_grid import BYTES_PER_SITE, site_shape
from chemage.scene.cost import Cost
from chemage.scene.scene import Scene

#: runs that take longer than this say so first, s
LONG = 3600.0
#: heights, their transform, and the pressure: what any solver has in memory for each pixel at least
BYTES_PER_PIXEL = 24.0


class LongRunWarning(PlanWarning):
    """A run will take hours."""


def at_once(scene: Scene) -> int:
    """How many replicas run at the same time."""
    if scene.hold is None or scene.engine is None:
        return 1
    return max(1, min(scene.hold.replicas, available() // scene.engine.concurrency()))


def memory(scene: Scene, known: Cost) -> tuple[float, float]:
    """Bytes that the contact and the replicas need at least, as far as it is known."""
    contact = max(known.contact_bytes or 0.0, BYTES_PER_PIXEL * known.pixels)
    if not scene.ages or scene.hold is None:
        return contact, 0.0
    kept = kept_bytes(scene.hold.replicas, scene.hold.hold_times.size)
    return contact, kept + (known.replica_bytes or 0.0) * at_once(scene)


def check_limits(scene: Scene, known: Cost) -> None:
    """Refuse a scene that this machine cannot hold, or whose parts do not fit together.

    Raises
    ------
    InputError
        With the numbers and the remedy.
    """
    contact, replicas = memory(scene, known)
    grid = f"{known.surface.get('nx', 0):.0f} x {known.surface.get('ny', 0):.0f} pixels"
    require(contact, f"[surface] {grid}", "use fewer pixels")
    if scene.hold is not None:
        count, times = scene.hold.replicas, scene.hold.hold_times.size
        grids = scene.site_grids
        if grids and scene.load > 0:  # a contact has one pixel at least
            least = grids[1][0] * grids[1][1] / (grids[0][0] * grids[0][1])
            require(BYTES_PER_SITE * least, f"[chemistry] {least:.3g} sites per pixel", "use a smaller site_density")
        on = f" on {grids[1][0]} x {grids[1][1]} sites" if grids and grids[1] != grids[0] else ""
        remedy = "ask for fewer replicas, or fewer hold times" + (", or use a smaller site_density" if on else "")
        require(replicas, f"[hold] {count} replicas at {times} hold times{on}", remedy)


def check_parts(scene: Scene, known: Cost) -> list[str]:
    """Refuse what the parts of a scene would refuse during the run, as far as it is known before; return what they
    warn of, as sentences.

    Raises
    ------
    InputError
        Naming the section.
    """
    stage, doubts = "contact", []
    try:
        doubts += scene.contact.check(known.surface, scene.load) or ()
        stage = "ageing"
        if scene.ages and scene.engine is not None and scene.chemistry is not None:
            if {"nx", "ny", "pixel_size"} <= known.surface.keys():
                pixels = int(known.surface["nx"]), int(known.surface["ny"])
                shape = site_shape(pixels, known.surface["pixel_size"], scene.chemistry.site_density)
                if scene.ageing is not None:
                    doubts += scene.ageing.check_sites(shape, known.sites) or ()
            doubts += scene.engine.check(scene.chemistry.interaction is not None) or ()
    except InputError as error:
        error.add_note(f"in the stage {stage!r} of scene {scene.name!r}")
        raise
    return doubts


def duration(scene: Scene, known: Cost, *, most: bool = False) -> float | None:
    """Wall time of a run, s; None where a component gives no estimate. ``most``: of a range, its upper end."""
    if known.contact_cpu_seconds is None or known.kinetics_cpu_seconds is None:
        return None
    concurrent = at_once(scene) * (scene.engine.concurrency() if scene.engine is not None else 1)
    kinetics = known.kinetics_range[1] if most and known.kinetics_range else known.kinetics_cpu_seconds
    return known.contact_cpu_seconds / available() + kinetics / min(concurrent, available())


def long_run(scene: Scene, known: Cost) -> str:
    """What to say of a run that takes hours; "" of any other."""
    seconds = duration(scene, known, most=True)
    if seconds is None or seconds < LONG:
        return ""
    about = "up to" if known.kinetics_range else "about"
    why = f" ({known.range_reason})" if known.kinetics_range else ""
    return (
        f"this will take {about} {in_hours(seconds)} on {available()} threads{why}; fewer replicas or pixels take "
        "less, and with checkpoints an interrupted run resumes"
    )


def in_hours(seconds: float) -> str:
    """A long time in minutes, hours or days."""
    if seconds < LONG:
        return f"{seconds / 60:.2g} minutes"
    return f"{seconds / 3600:.2g} hours" if seconds < 48 * 3600 else f"{seconds / 86400:.3g} days"
