"""The command cite."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from chemage.cli.options import user_error

if TYPE_CHECKING:
    from chemage.foundation.components import Component
    from chemage.scene.citations import Reference
    from chemage.studies.sweeps.grid import Grid


def cite(
    what: Annotated[str, typer.Argument(help="a result file (.h5), the folder of a sweep, or a scene")],
    fmt: Annotated[str, typer.Option("--format", help="bibtex, or text: one line per publication")] = "bibtex",
) -> None:
    """Print what to cite, as BibTeX.

    These are chemage, the paper of its model, and the publications of the components that were used.
    """
    from chemage.scene.citations import bibtex, text

    if fmt not in ("bibtex", "text"):
        raise user_error(f"--format {fmt}: choose bibtex or text")
    found = _references(what)
    print(bibtex(found) if fmt == "bibtex" else text(found), end="")


def _references(what: str) -> list[Reference]:
    from chemage.plugins import registry
    from chemage.results.files import read
    from chemage.scene.citations import references
    from chemage.scene.files import scene_data
    from chemage.scene.parsing import parse_scene
    from chemage.studies.sweeps.grid import Grid
    from chemage.studies.sweeps.result import load_sweep

    path = Path(what)
    if path.is_dir():
        sweep = load_sweep(path)
        return _of_components(_of_grid(sweep.grid), sweep.versions.get("chemage"))
    if path.is_file() and path.suffix != ".toml" and what not in registry.current().scenes():
        return references(*_of_result(read(path, maps=False)))
    data, source = scene_data(what)
    if "sweep" in data:
        return _of_components(_of_grid(Grid.read(data, source)))
    return _of_components(parse_scene(data, source).components())


def _of_components(components: Iterable[Component], version: str | None = None) -> list[Reference]:
    from chemage.scene.citations import references

    known = list(components)
    texts = [text for one in known for text in one.cite]
    return references(texts, known, **({"version": version} if version else {}))


def _of_grid(grid: Grid) -> Iterator[Component]:
    """The components of all points; only an axis of kinds or of whole sections changes them."""
    varied = [
        range(len(axis))
        if any(path.endswith("kind") for path in axis.paths)
        or any(isinstance(value, dict | bool) for row in axis.values for value in row)
        else (0,)
        for axis in grid.axes
    ]
    for places in itertools.product(*varied):
        point = 0
        for axis, place in zip(grid.axes, places, strict=True):
            point = point * len(axis) + place
        yield from grid.scene(point).components()


def _of_result(thing: Any) -> tuple[list[str], list[Component], str]:
    """Texts, components and the version of chemage of what a result file holds."""
    from chemage.ageing.aging import Aging
    from chemage.foundation.version import __version__
    from chemage.inference.result import Inference
    from chemage.scene.provenance import components_of
    from chemage.scene.run import Run
    from chemage.studies.ensembles.ensemble import Ensemble
    from chemage.surfaces.surface import Surface

    if isinstance(thing, Ensemble | Inference):
        provenance = thing.provenance
        components = [component for _, component in components_of(provenance.get("scene", {}))]
        return provenance.get("cite", []), components, provenance.get("versions", {}).get("chemage", __version__)
    if isinstance(thing, Run):
        components = [component for _, component in components_of(thing.scene, thing.aging)]
        return list(thing.cite), components, thing.versions.get("chemage", __version__)
    aging = thing if isinstance(thing, Aging) else None
    provenance = getattr(thing, "provenance", {})
    contact = {"surface": provenance} if isinstance(thing, Surface) else provenance
    components = [one for _, one in components_of({}, aging, contact if aging is None else None)]
    return [text for one in components for text in one.cite], components, __version__
