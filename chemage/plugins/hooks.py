"""The markers of hooks, the hooks by which a plugin offers components and commands, and what a room declares of a
stage.

A plugin is a module (or package) named by an entry point in the group ``chemage``; its functions marked with
``chemage.plugin.hookimpl`` implement hooks. A plugin may leave out arguments that it does not need. Arguments are only
ever added; a changed meaning is a new hook.

The module ``hooks`` of a room specifies the hooks of its stages and declares these in ``STAGES``: the section of a
scene, and everything that the framework asks of it. So does the module of a plugin, whose stages change what others
make. Scenes, their schema, keys, plans, runs and provenance loop over all of them. A stage is given the *parts* of a
scene: by section its component or its options (``surface``, ``forming``, ``hold``), and what stands beside the options
of a component (``surface.seed``, ``contact.load``); and what is *stated* before anything is computed: by section the
numbers that its :meth:`Stage.estimate` stated.
"""

from __future__ import annotations

from collections.abc import (
    Callable,
    Collection,
    Iterable,
    Iterator,
    Mapping,
    Sequence,
)
from dataclasses import dataclass, field
from functools import cached_property
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import pluggy

from chemage.foundation.aliases import Data, Fields
from chemage.foundation.errors import imported
from chemage.foundation.ownership import Owned

#: A plugin module may set ``CHEMAGE_API = 1``; one made for another version is reported and skipped.
API_VERSION = 1
#: versions whose modules are still loaded
SUPPORTED_API_VERSIONS = (1,)

#: what a plugin may offer besides components, each by a hook, as name -> target: in the plural, and one of it
OFFERED = {
    "scenes": "scene",
    "materials": "material",
    "results": "result",
    "names": "name",
}
#: hooks that are called once, at discovery, by which a plugin offers what it has
OFFERS = ("chemage_register", *(f"chemage_{what}" for what in OFFERED))

hookspec = pluggy.HookspecMarker("chemage")
hookimpl = pluggy.HookimplMarker("chemage")


def lazy_attributes(
    kinds: Mapping[str, Mapping[str, str]], *further: str
) -> Callable[[str], Any]:
    """The ``__getattr__`` of a plugin package: the classes in ``kinds``, as for :func:`chemage_register`, and
    ``further`` objects (``"module:name"``), each imported on first use."""
    paths = [
        *further,
        *(path for offered in kinds.values() for path in offered.values()),
    ]
    homes = {
        name: module for module, _, name in (path.partition(":") for path in paths)
    }

    def attribute(name: str) -> Any:
        if name not in homes:
            raise AttributeError(
                f"no attribute {name!r}; there are {', '.join(sorted(homes))}"
            )
        return getattr(import_module(homes[name]), name)

    return attribute


@hookspec
def chemage_register() -> Mapping[str, Mapping[str, str]]:  # pyright: ignore[reportReturnType]
    """Offer components: ``{role: {kind: "module:Class"}}``.

    Strings, so that discovery imports nothing heavy; the class is imported when the kind is first used.
    """


@hookspec
def chemage_results() -> Mapping[str, str]:  # pyright: ignore[reportReturnType]
    """Offer kinds of results: ``{group of a file: "module:Class"}``, a :class:`chemage.plugin.Record` each.

    ``chemage.write`` and ``chemage.read`` then know them. The module ``display`` beside that of the class says how they
    are shown (:func:`chemage.plugin.displays`); it is imported when one of them is.
    """


@hookspec
def chemage_names() -> Mapping[str, str]:  # pyright: ignore[reportReturnType]
    """Offer names of ``chemage`` to users: ``{name: "module:object"}``, each imported when it is first used."""


@hookspec
def chemage_cli() -> Sequence[tuple[str, Any]]:  # pyright: ignore[reportReturnType]
    """Add commands: ``[(name, function), ...]``; typer makes the command line from the signature of the function."""


Parts: TypeAlias = Fields
Stated: TypeAlias = Mapping[str, Mapping[str, float]]

#: what a scene says before and after the sections of its stages
TOP, BOTTOM = ("name", "title", "material"), ("plugins", "sweep")
#: the keys of a scene, each of which contains the one before it
KEYS = ("surface", "contact", "ageing", "result")


class Doubt(NamedTuple):
    """One thing to warn of: ``kind`` is the same for the same doubt at every point of a sweep."""

    kind: str
    text: str


@dataclass(frozen=True)
class Beside:
    """An entry of a section that is no option of its component."""

    #: the field of the scene that holds it
    field: str
    #: its JSON Schema
    schema: Fields
    unit: str = ""
    required: bool = False


@dataclass(frozen=True)
class StageInputs:
    """What a stage has when it runs."""

    #: what the scene says, see :mod:`chemage.plugins.hooks`
    parts: Parts
    #: what the stages before it made: "surface", "contact", "ageing"
    made: Fields
    #: how many threads it may use; None: all
    threads: int | None = None
    #: the folder in which what would take long to make again is kept during a run
    checkpoints: Path | None = None
    #: called with (steps done, steps in all), where somebody watches
    progress: Callable[[int, int], None] | None = None


@dataclass(frozen=True)
class Stage(Owned):
    """The declaration of one stage, or of what a scene says beside its stages.

    A stage that computes names what it ``takes`` and what it ``makes``, and has a method :meth:`run`. One that takes
    what it makes changes it: it runs after the stage that made it, and before those that only take it.
    """

    section: str
    #: role of its component; "" where :meth:`model` gives the class of its options
    role: str = ""
    #: options of :meth:`model` that are sections of their own -> role
    parts: Mapping[str, str] = field(default_factory=dict)
    #: what its section is, in words
    about: str = ""
    #: one of ``parts`` -> what is said of the sections that need it where it is missing
    missing: Mapping[str, str] = field(default_factory=dict)
    #: [[section]]: any number of components, or of the options of :meth:`model`, in their order
    many: bool = False
    #: entries of the section beside the options of its component
    beside: Mapping[str, Beside] = field(default_factory=dict)
    #: whether every scene has it
    required: bool = False
    #: a section with which it is required, and what is said where it is missing then
    required_with: tuple[str, str] | None = None
    #: a section without which it is an error
    needs: str = ""
    #: a section without which it means nothing
    only_with: str = ""
    #: stages it rests on, by section
    inputs: tuple[str, ...] = ()
    #: what it is given when it runs, and what it makes: "surface", "contact", "ageing"; "" where it computes nothing
    takes: tuple[str, ...] = ()
    makes: str = ""
    #: the key (:data:`KEYS`) that its options are part of; default: of what it makes, "" for none
    key: str = ""
    #: whether the key says so where it is absent; False: such keys are those of scenes from before there was this stage
    always_in_key: bool = False
    #: whether a material gives its options
    of_material: bool = False
    #: the hooks whose implementations take part in it
    hooks: tuple[str, ...] = ()
    #: ``"module:Class"`` that :meth:`model` gives
    options: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "key", self.key or self.makes)

    def _title(self) -> str:
        return f"stage {self.section!r}"

    @cached_property
    def roles(self) -> dict[str, str]:
        """Section -> role of what stands in it, ``parts`` first; "" where its options are those of :meth:`model`."""
        return {**self.parts, self.section: self.role}

    @cached_property
    def entries(self) -> dict[str, Beside]:
        """``beside`` by path in a scene."""
        return {
            f"{self.section}.{name}": entry for name, entry in self.beside.items()
        }

    @cached_property
    def changes(self) -> bool:
        """Whether it makes anew what another stage made."""
        return self.makes in self.takes

    def asked(self, parts: Parts) -> bool:
        """Whether a scene with these parts lets it run."""
        return self.section in parts

    def taken(self, parts: Parts) -> tuple[str, ...]:
        """What it ``takes`` in a scene with these parts."""
        return self.takes

    def run(self, inputs: StageInputs) -> Any:
        """What it makes, of the class of what it changes; what it measures it records
        (:func:`chemage.plugin.record`)."""
        raise NotImplementedError(
            f"the stage {self.section!r} makes {self.makes!r} and has no method run"
        )

    def fills(self, data: Fields) -> Mapping[str, Data]:
        """What its section in the ``data`` of a scene decides of other sections, which then must not say it: section ->
        options."""
        return {}

    def method(self, parts: Parts) -> Any:
        """The :class:`chemage.plugin.AgeingMethod` by which a scene with its section ages; None: that of [ageing]."""
        return None

    def model(self) -> Any:
        """The class of its options, where it has no role; None for a table that :meth:`make` reads."""
        return imported(self.options) if self.options else None

    def make(self, options: Fields) -> Any:
        """What the options of its section mean, where there is neither role nor model; raises InputError."""
        return dict(options)

    def schema(self) -> Fields:
        """The JSON Schema of its section, where there is neither role nor model."""
        return {"type": "object"}

    def read_beside(self, name: str, value: Any, parts: Parts) -> Any:
        """The value of one of ``beside``, None where the scene has none; raises ChemageError."""
        return value

    def locate_beside(self, name: str, value: Any, folder: Path) -> Any:
        """One of ``beside`` as written in a file in ``folder``, from which a relative path in it starts."""
        return value

    def problems(self, parts: Parts) -> Iterable[tuple[str, str]]:
        """What is wrong although every section is right by itself: (path, message)."""
        return ()

    def todict(self, parts: Parts, options_of: Callable[[Any], Data]) -> Data:
        """Its sections as plain data; ``options_of`` gives the options of a component."""
        if (value := parts.get(self.section)) is None:
            return {}
        if self.many:
            return {self.section: [*map(options_of, value)]}
        if hasattr(value, "identity"):
            options = options_of(value)
        elif hasattr(value, "model_dump"):
            options = value.model_dump(mode="json", exclude_none=True)
        else:
            options = dict(value)
        data, own = {}, dict(options)
        for name in self.parts:
            own.pop(name, None)
            if name in parts:
                data[name] = options_of(parts[name])
        for name in self.beside:
            own[name] = parts[f"{self.section}.{name}"]
        return {**data, self.section: own}

    def fault(self, answer: Any, arguments: Fields) -> str:
        """What contradicts itself in the ``answer`` to its hook, or the ``arguments`` of the call, in words; "" if
        nothing does. Asked of what its component gives, and of all that a plugin answers or changes."""
        return ""

    def fault_of(self, made: Any, inputs: StageInputs) -> str:
        """The :meth:`fault` of what a plugin's stage changed of what this one made."""
        return ""

    def key_entries(self, sections: Fields) -> list[Any]:
        """What its sections, as plain data, add to its key."""
        if self.always_in_key:
            return [sections.get(name) for name in self.roles]
        return (
            [{self.section: sections[self.section]}]
            if self.section in sections
            else []
        )

    def key_ends(self, parts: Parts) -> Fields:
        """What it adds beside its options, after all sections: key -> content."""
        return {}

    def recorded(self, ageing: Fields, contact: Fields) -> Fields:
        """Path -> plain options with kind, as the provenance of an ageing curve and of its contact has them."""
        return {
            self.section: (contact if self.makes == "contact" else ageing).get(
                self.section
            )
        }

    def estimate(self, parts: Parts, stated: Stated) -> Mapping[str, float]:
        """What is stated of it before anything is computed; ``cpu_seconds`` among it, on the machine of reference."""
        return {}

    def rows(self, parts: Parts, stated: Stated) -> Mapping[str, str]:
        """Name -> what is modelled, in words."""
        component = parts.get(self.section)
        return (
            {self.section: component.kind}
            if self.role and not self.many and component is not None
            else {}
        )

    def doubts(self, parts: Parts, stated: Stated) -> Iterator[Doubt]:
        """What to warn of; raises InputError for what the run would refuse."""
        yield from ()

    def doubts_of_sweep(
        self, parts: Parts, varied: Collection[str]
    ) -> Iterator[Doubt]:
        """What to warn of where the fields ``varied`` (dotted paths) vary from scene to scene."""
        yield from ()

    def warm_up(self, parts: Parts) -> None:
        """Compile what a run will need."""


def options_in(provenance: Any) -> Data:
    """The component that made a surface or a contact, where its provenance has ``kind`` and ``options``."""
    if not isinstance(provenance, Mapping) or not isinstance(
        provenance.get("options"), Mapping
    ):
        return {}
    return {**provenance["options"], "kind": provenance.get("kind")}


def in_order(stages: Iterable[Stage]) -> list[Stage]:
    """Stages after those that they rest on, and otherwise as they were declared."""
    declared = {stage.section: stage for stage in stages}
    makers = {
        stage.makes: stage.section
        for stage in declared.values()
        if stage.makes and not stage.changes
    }
    changers: dict[str, list[str]] = {}
    for stage in declared.values():
        if stage.changes:
            changers.setdefault(stage.makes, []).append(stage.section)
    ordered: dict[str, Stage] = {}

    def before(stage: Stage) -> Iterator[str]:
        yield from stage.inputs
        for name in stage.takes:
            yield makers[name]
            others = changers.get(name, [])
            yield from (
                others[: others.index(stage.section)]
                if stage.makes == name
                else others
            )

    def add(stage: Stage, above: tuple[str, ...] = ()) -> None:
        if stage.section in above:
            raise ValueError(
                f"each of these stages needs the next: {', '.join((*above, stage.section))}"
            )
        for name in before(stage):
            if name not in ordered:
                add(declared[name], (*above, stage.section))
        ordered.setdefault(stage.section, stage)

    for stage in declared.values():
        add(stage)
    return list(ordered.values())
