"""Which completed contacts and points of a sweep other plugins made than those in use now.

Every point and every contact names the plugins that took part in it, and the folder those that were asked about all of
them. A plugin that took part and is no longer in use in that version makes the point out of date. A plugin with hooks
that the folder does not know yet is asked, stage by stage: one that answers nothing changes nothing.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from chemage.contacts.solution import ContactSolution
from chemage.plugins.context import Plugins
from chemage.plugins.sources import changed, implementing, providers, would_change
from chemage.scene.run import aged
from chemage.scene.scene import Scene
from chemage.studies.folder import Folder
from chemage.studies.sweeps.grid import Survey, order_of
from chemage.surfaces.role import make_surface
from chemage.surfaces.surface import Surface

_CONTACT_HOOKS = ("chemage_make_surface", "chemage_solve_contact")
_AGEING_HOOKS = ("chemage_build_lattice", "chemage_run_kinetics", "chemage_rupture_bonds", "chemage_observe")


@dataclass
class Outdated:
    """What must be computed again."""

    #: keys
    points: set[str] = field(default_factory=set)
    contacts: set[str] = field(default_factory=set)
    #: plugin -> what changed, in words
    reasons: dict[str, str] = field(default_factory=dict)

    def __bool__(self) -> bool:
        return bool(self.points or self.contacts)

    def describe(self) -> str:
        """One sentence for users."""
        what = f"{len(self.points)} points and {len(self.contacts)} contacts are computed again"
        return f"{what}, because plugins changed: {'; '.join(self.reasons.values())}"

    def remove(self, folder: Folder) -> None:
        """Remove the files."""
        for key in self.points:
            folder.point(key).unlink(missing_ok=True)
        for key in self.contacts:
            folder.contact(key).unlink(missing_ok=True)


def outdated(folder: Folder, survey: Survey, there: Mapping[str, Any]) -> Outdated:
    """Compare the completed part of ``folder``, whose manifest is ``there``, with the plugins in use."""
    result = Outdated()
    asked = there.get("asked", {})
    new = {name: source for name, source in survey.hooks.items() if asked.get(name) != source}
    check = _Check(folder, survey, new, result)
    points: dict[int, list[int]] = {}
    for point, contact in enumerate(survey.contact_of):
        points.setdefault(contact, []).append(point)
    for number in order_of(survey.contacts):
        check.contact(number, points.get(number, []))
    return result


class _Check:
    def __init__(self, folder: Folder, survey: Survey, new: Plugins, result: Outdated) -> None:
        self.folder, self.survey, self.result = folder, survey, result
        self.new_in_contact = [name for name in implementing(*_CONTACT_HOOKS) if name in new]
        self.new_in_ageing = [name for name in implementing(*_AGEING_HOOKS) if name in new]
        self._surface: tuple[str, Surface] | None = None

    def contact(self, number: int, points: list[int]) -> None:
        keys = {self.survey.keys[point]: point for point in points}
        done = {key: content for key in keys if (content := self.folder.read_point(key))["status"] == "done"}
        touched = {key: self._changed(content.get("plugins", {})) for key, content in done.items()}
        contact = self.survey.contacts[number]
        if not (any(touched.values()) or self.new_in_contact or self.new_in_ageing or not done):
            return
        solution = self.folder.intact_contact(contact.key)
        if solution is None:
            self.result.points |= {key for key, changes in touched.items() if changes}
            return
        scene = self.survey.grid.scene(contact.point)
        if self._changed(solution.plugins) or self._contact_would_change(scene, contact.surface, solution):
            self.result.contacts.add(contact.key)
            self.result.points |= set(done)
            return
        for key in done:
            if touched[key] or self._ageing_would_change(self.survey.grid.scene(keys[key]), solution):
                self.result.points.add(key)

    def _changed(self, recorded: Plugins) -> bool:
        # options of plugins are in the keys of the points
        changes = changed(recorded, options=False)
        for name, (then, now) in changes.items():
            self.result.reasons[name] = f"{name} was {then} and is {now}"
        return bool(changes)

    def _contact_would_change(self, scene: Scene, key: str, solution: ContactSolution) -> bool:
        if not self.new_in_contact:
            return False
        with scene.in_use():
            if self._surface is None or self._surface[0] != key:
                self._surface = key, make_surface(scene.surface, scene.surface_seed)
            surface = self._surface[1]
            took_part = [name for name in self.new_in_contact if name in surface.plugins]
            if not took_part and would_change(
                self.new_in_contact,
                "chemage_solve_contact",
                solution,
                solver=scene.solver,
                surface=surface,
                load=scene.load,
                start=None,
            ):
                took_part = self.new_in_contact
        return self._joined(took_part)

    def _ageing_would_change(self, scene: Scene, solution: ContactSolution) -> bool:
        # one replica goes through all stages after the contact
        aging = aged(scene, solution, replicas=1) if self.new_in_ageing else None
        if aging is None:
            return False
        provide = providers(*scene.components())
        return self._joined([name for name in self.new_in_ageing if name in aging.plugins and name not in provide])

    def _joined(self, names: list[str]) -> bool:
        for name in names:
            self.result.reasons.setdefault(name, f"{name} ({self.survey.hooks[name]}) answers or changes them now")
        return bool(names)
