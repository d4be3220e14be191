"""``chemage selftest``: the checks of the kit against closed forms and known numbers, on the machine of the user.

The components are those of the installed scenes, and others of whose options these scenes have the values, so that no
kind is named here and those of plugins are tested as well.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from chemage.foundation import container, random, threads
from chemage.foundation.components import Component
from chemage.foundation.errors import (
    ChemageError,
    InputError,
    MissingError,
    PluginError,
)
from chemage.foundation.files import read_bytes, write_file
from chemage.foundation.records import Record
from chemage.plugins import registry
from chemage.plugins.sources import components_in
from chemage.scene.files import is_sweep, load_scene
from chemage.studies.runner import Processes
from chemage.surfaces.surface import Surface
from chemage.testing.checks import CheckFailed, checks_for, refuses, require
from chemage.testing.contacts import rough_surface
from chemage.testing.trials import Trial


class PartOutcome(NamedTuple):
    """How the tests of one part ended."""

    #: role and kind, or another part of chemage
    part: str
    #: tests that passed, and what is wrong, a text for each that did not
    passed: int
    problems: list[str]
    seconds: float
    #: why there are none; "" where there are
    untested: str = ""


def selftest() -> Iterator[PartOutcome]:
    """Run the tests: random numbers and files, then every component that can be made, in a process on each processor."""
    yield _outcome("random numbers", [random_numbers_are_the_published_ones])
    yield _outcome(
        "files", [files_give_back_what_was_written, bytes_are_the_known_ones]
    )
    components, unmade = examples()
    with Processes(threads.available()) as pool:
        running = [(one, pool.submit(_tested, one)) for one in components]
        for component, future in running:
            try:
                outcome = future.result()
            except BrokenExecutor as death:
                outcome = PartOutcome(_part(component), 0, [str(death)], 0.0)
            if outcome is not None:
                yield outcome
    yield from (PartOutcome(part, 0, [], 0.0, why) for part, why in unmade.items())


def _part(component: Component) -> str:
    return f"{component.role} {component.kind}"


def _tested(component: Component) -> PartOutcome | None:
    """How the tests of a component ended; None where it has none."""
    with tempfile.TemporaryDirectory() as folder:
        ready, inputs = _with_file(component, Path(folder))
        known = [
            check
            for check in checks_for(ready, **inputs)
            if getattr(check.function, "known", False)
        ]
        if not known:
            return None
        if tests := [partial(check, ready) for check in known if not check.missing]:
            return _outcome(_part(component), tests)
        why = f"it needs {' and '.join(known[0].missing)}"
        return PartOutcome(_part(component), 0, [], 0.0, why)


def _outcome(part: str, tests: list[Callable[[], None]]) -> PartOutcome:
    begin, problems = time.perf_counter(), []
    for test in tests:
        try:
            test()
        except MissingError as missing:
            return PartOutcome(part, 0, [], 0.0, str(missing))
        except CheckFailed as failure:
            problems.append(f"{failure.check}: {failure.args[2]}")
        except Exception as error:
            problems.append(f"{type(error).__name__}: {error}")
    return PartOutcome(
        part, len(tests) - len(problems), problems, time.perf_counter() - begin
    )


def examples() -> tuple[list[Component], dict[str, str]]:
    """One component of each kind that computes or reads, and role and kind of the others with the reason."""
    plugins = registry.current()
    used: dict[type, Any] = {}
    values: dict[tuple[str, str], Any] = {}
    for name in plugins.scenes():
        if not is_sweep(name):
            for part in components_in(load_scene(name).parts):
                used.setdefault(type(part), part)
                values |= {
                    (part.role, option): getattr(part, option)
                    for option in part.model_fields_set
                }
    components, unmade = [], {}
    for role in plugins.roles:
        # the surfaces of scenes are too large, and that contacts of known ones are found tests what matters of them
        for kind in plugins.kinds(role) if role != Surface.__name__.lower() else ():
            try:
                cls = plugins.component(role, kind)
                options = {
                    option: values[role, option]
                    if (role, option) in values
                    else field.examples[0]
                    for option, field in cls.model_fields.items()
                    if field.is_required()
                    and ((role, option) in values or field.examples)
                }
                components.append(used.get(cls) or cls(**options))
            except (InputError, PluginError) as error:
                unmade[f"{role} {kind}"] = str(error)
    return components, unmade


def _with_file(component: Any, folder: Path) -> tuple[Any, dict[str, Any]]:
    """A component and the inputs of its checks: of a reader a file, where numpy or h5py can write what it reads."""
    endings = [
        one
        for one in (".npy", ".txt", ".h5")
        if one in getattr(component, "suffixes", ())
    ]
    if not endings:
        return component, {}
    surface = rough_surface((6, 9), periodic=False)
    path = folder / f"{component.kind}{endings[0]}"
    if endings[0] == ".npy":
        np.save(path, surface.heights)
    elif endings[0] == ".txt":
        np.savetxt(
            path, surface.heights, header=f"pixel_size = {surface.pixel_size}"
        )
    else:
        import h5py

        with h5py.File(path, "w") as file:
            file["heights"] = surface.heights
    return component.replace(pixel_size=surface.pixel_size), {
        "path": path,
        "surface": surface,
    }


# -- what is no component ---------------------------------------------------------------------------------------------


def random_numbers_are_the_published_ones() -> None:
    """Philox4x32-10 at counter and key 0: known answers of Random123 1.14 (Salmon et al., SC'11, 16, 2011)."""
    words = random.philox(*(np.uint64(0) for _ in range(6)))
    expected = (0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8)
    require(
        tuple(words) == expected, f"philox gives {[hex(word) for word in words]}"
    )


def files_give_back_what_was_written() -> None:
    """Records come back equal from both kinds of files, and a file of which one bit differs is refused."""
    replica = Trial(sites=12, bonded=5).replica()
    parts: dict[str, Record] = {
        type(part).__name__: part
        for part in (replica.contact, replica.lattice, replica.history)
    }
    kinds = {name: type(part) for name, part in parts.items()}
    with tempfile.TemporaryDirectory() as folder:
        for compact in (False, True):
            path = Path(folder) / f"file{compact}"
            container.write(path, parts, {"title": "selftest"}, compact=compact)
            require(
                container.read(path, kinds)[0] == parts,
                "records that were read differ from those written",
            )
            content = bytearray(read_bytes(path))
            content[len(content) // 2] ^= 1
            write_file(path, bytes(content), force=True)
            refuses(
                "a file with one wrong bit",
                lambda path=path: container.read(path, kinds),
                ChemageError,
            )


#: SHA-256 of a description, and the digest of a record
_SEALED = "9acf6655bba13d93aeabe4223eceb6b4d8866b6661dbb7b34ac403454007dcc0"
_DIGEST = "7e6fff3f2d1891139adce0feac1a830f"


def bytes_are_the_known_ones() -> None:
    """Descriptions have the bytes, and records the digests, that they have everywhere."""
    sealed = container.sealed_json({"title": "selftest", "numbers": [1, 2.5, 1e-9]})
    require(
        _SEALED in sealed.decode(), f"a description has other bytes: {sealed!r}"
    )
    record = container.Arrays(
        values={"a": np.arange(6.0).reshape(2, 3), "b": np.arange(4)}
    )
    require(
        record.digest() == _DIGEST, f"the digest of a record is {record.digest()}"
    )
