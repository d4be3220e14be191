"""What took part in a result, and what to cite for it: as BibTeX, or as lines of text.

A component states its publications as texts (``cite``), and may give a BibTeX entry for each (``bibtex``). A text
without an entry becomes ``@misc`` with the text as its note.
"""

from __future__ import annotations

import platform
import re
import unicodedata
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from importlib import metadata

from chemage.ageing.ageing import Ageing
from chemage.foundation.aliases import Fields
from chemage.foundation.components import Component
from chemage.foundation.errors import ChemageError
from chemage.foundation.machine import processor
from chemage.foundation.names import __version__
from chemage.foundation.records import Record
from chemage.plugins import registry
from chemage.plugins.sources import nested, providers
from chemage.scene.scene import Scene
from chemage.surfaces.role import Scatter, SurfaceMaker

#: libraries on whose versions the last bits of a result depend
LIBRARIES = ("numpy", "scipy", "numba", "h5py")


def versions(
    scene: Scene | None = None, results: tuple[Record | None, ...] = ()
) -> dict[str, str]:
    """Versions of chemage, of the libraries below it, and of the plugins that took part; and the processor.

    Those are the plugins that provide the components of ``scene``, and those that took part in ``results``; and the
    libraries that they name as their basis.
    """
    numbers = {
        "chemage": __version__,
        "python": platform.python_version(),
        "processor": processor(),
    }
    for name in LIBRARIES:
        numbers[name] = _version(name)
    taking_part = providers(*scene.components()) if scene is not None else {}
    for result in results:
        if result is not None:
            taking_part |= result.plugins
    records = {record.name: record for record in registry.current().records}
    for name, source in sorted(taking_part.items()):
        record = records.get(name)
        if record is None:
            numbers.setdefault(name, source)
            continue
        numbers.setdefault(record.distribution or name, record.version or source)
        for library, version in record.libraries.items():
            numbers.setdefault(library, version)
    return numbers


@lru_cache
def _version(distribution: str) -> str:
    # reading a distribution's metadata takes a millisecond, and a sweep needs it at every point
    return metadata.version(distribution)


def components_of(
    scene: Fields,
    ageing: Ageing | None = None,
    contact: Fields | None = None,
) -> list[tuple[str, Component]]:
    """The components that a result was made with, as far as their plugins are installed: (path, component).

    They are found in the plain data of its scene, or else in the provenance of the ageing curve or of the ``contact``.
    """
    return [
        part
        for path, role, options in _recorded(scene, ageing, contact)
        if (component := _installed(role, options)) is not None
        for part in nested(component, path)
    ]


def scatter_of(
    scene: Fields, ageing: Ageing | None, contact: Mapping[str, float]
) -> Scatter | None:
    """What the maker of a result's surface knows of the scatter between surfaces (:meth:`SurfaceMaker.scatter`).

    ``contact`` are the measures of the contact; the other arguments are those of :func:`components_of`.
    """
    for _, role, options in _recorded(scene, ageing, None):
        if role == SurfaceMaker.role:  # the other components need not be imported
            maker = _installed(role, options)
            return (
                maker.scatter(contact) if isinstance(maker, SurfaceMaker) else None
            )
    return None


def _recorded(
    scene: Fields, ageing: Ageing | None, contact: Fields | None
) -> Iterator[tuple[str, str, Fields]]:
    """(path, role, plain options with kind) of each component."""
    provenance = ageing.provenance if ageing is not None else {}
    below = contact or provenance.get("contact") or {}
    for stage in registry.stages():
        stored = stage.recorded(provenance, below)
        for section, role in stage.roles.items():
            options = scene.get(section) or stored.get(section)
            if stage.many:
                yield from (
                    (f"{section}.{number}", role, table)
                    for number, table in enumerate(options or ())
                )
            elif isinstance(options, Mapping) and "kind" in options:
                beside = stage.beside if scene.get(section) else ()
                own = {k: v for k, v in options.items() if k not in beside}
                yield section, role, own


def _installed(role: str, options: Fields) -> Component | None:
    try:
        return registry.current().fromdict(role, options)
    except ChemageError:  # another version of the plugin, or none
        return None


#: the paper that describes the model
PAPER = "Z. Li, L. Pastewka, I. Szlufarska, Phys. Rev. E 98, 023001 (2018)"
_PAPER_BIBTEX = """@article{li2018,
  author = {Li, Z. and Pastewka, L. and Szlufarska, I.},
  title = {Chemical aging of large-scale randomly rough frictional contacts},
  journal = {Physical Review E},
  volume = {98},
  pages = {023001},
  year = {2018},
  doi = {10.1103/PhysRevE.98.023001},
}"""
_ENTRY = re.compile(r"\s*@(\w+)\s*\{\s*([^\s,{}]+)\s*,(.*)\}\s*\Z", re.DOTALL)
_DOI = re.compile(r"\b10\.\d{4,9}/[^\s,;]+")
#: what LaTeX takes for a command
_SPECIAL = {
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
}
_SPECIAL |= {letter: f"\\{letter}" for letter in "&%$#_"}
_SPECIAL |= {"{": r"\textbraceleft{}", "}": r"\textbraceright{}"}


@dataclass(frozen=True)
class Reference:
    """A publication: as text, and its BibTeX entry where it is known."""

    text: str
    bibtex: str = ""


def bibtex_problem(entry: str) -> str:
    """Why ``entry`` is not one BibTeX entry; "" where it is."""
    if (match := _ENTRY.match(entry)) is None:
        return "is not of the form @type{key, field = {value}, ...}"
    depth = 0
    for letter in match[3]:  # BibTeX counts those after a backslash as well
        depth += (letter == "{") - (letter == "}")
        if depth < 0:
            break
    return "" if depth == 0 else "has braces that do not match"


def references(
    texts: Iterable[str],
    components: Iterable[Component | type[Component]],
    version: str = __version__,
) -> list[Reference]:
    """What to cite: chemage itself, the paper of its model, and ``texts``, whose entries ``components`` may know."""
    entries = {PAPER: _PAPER_BIBTEX}
    for component in components:
        cls = component if isinstance(component, type) else type(component)
        entries |= {text: entry for text, entry in entries_of(cls).items() if entry}
    title = "chemage: chemical ageing of frictional contacts"
    own = Reference(
        f"The chemage developers, {title}, version {version}", _own(title, version)
    )
    return [
        own,
        *(
            Reference(text, entries.get(text, ""))
            for text in dict.fromkeys([PAPER, *texts])
        ),
    ]


def entries_of(cls: type[Component]) -> dict[str, str]:
    """Text -> BibTeX entry of a component; a class with texts of its own does not inherit entries."""
    owner = next(base for base in cls.__mro__ if "cite" in vars(base))
    return dict(
        zip(vars(owner)["cite"], vars(owner).get("bibtex", ()), strict=False)
    )


def _own(title: str, version: str) -> str:
    return f"""@misc{{chemage,
  author = {{{{The chemage developers}}}},
  title = {{{title}}},
  note = {{Software, version {latex(version)}}},
}}"""


def bibtex(cited: Iterable[Reference]) -> str:
    """References as the content of a ``.bib`` file; each entry has a key of its own."""
    entries = [
        reference.bibtex
        if reference.bibtex and not bibtex_problem(reference.bibtex)
        else _misc(reference.text)
        for reference in cited
    ]
    used: dict[str, int] = {}
    texts = []
    for entry in dict.fromkeys(entries):
        match = _ENTRY.match(entry)
        assert match is not None
        key = name = match[2]
        while name.lower() in used:
            used[key.lower()] += 1
            name = f"{key}{_suffix(used[key.lower()])}"
        used[name.lower()] = 0
        texts.append(f"@{match[1]}{{{name},\n  {match[3].strip()}\n}}\n")
    return "\n".join(texts)


def text(cited: Iterable[Reference]) -> str:
    """References as lines of text."""
    return "".join(f"{reference.text}\n" for reference in cited)


def latex(words: str) -> str:
    """``words`` on one line, so that LaTeX prints them: special characters escaped, letters as they are (UTF-8)."""
    return "".join(
        _SPECIAL.get(letter, letter) for letter in " ".join(words.split())
    )


def _misc(words: str) -> str:
    """A text of which nothing else is known, as an entry; its DOI and year where it names them."""
    fields: Mapping[str, str] = {"note": latex(words)}
    if years := re.findall(r"\((\d{4})\)", words) or re.findall(
        r"\b(1[89]\d\d|20\d\d)\b", words
    ):
        fields = {**fields, "year": years[-1]}
    if doi := _DOI.search(words):
        fields = {**fields, "doi": doi[0].rstrip(".")}
    lines = "".join(f"  {name} = {{{value}}},\n" for name, value in fields.items())
    return f"@misc{{{_key(words, fields.get('year', ''))},\n{lines}}}"


def _key(words: str, year: str) -> str:
    """The first author's surname and the year, as ``li2018``."""
    first = re.split(r",| and | & | et al|;|:", words.strip(), maxsplit=1)[
        0
    ].split()
    plain = (
        unicodedata.normalize("NFKD", first[-1] if first else "")
        .encode("ascii", "ignore")
        .decode()
    )
    return (re.sub(r"[^A-Za-z0-9]", "", plain).lower() or "reference") + year


def _suffix(number: int) -> str:
    """b, c, … z, then numbers."""
    return chr(ord("a") + number) if number < 26 else f"-{number}"
