"""What to cite: BibTeX that BibTeX can read, with a key for each entry."""

from __future__ import annotations

import re

import pytest

import chemage
from chemage.plugin import registry
from chemage.scene.provenance import bibtex, bibtex_problem, entries_of, latex, references

ENTRY = "@article{someone2001,\n  title = {A {B} C},\n}"


class Cited(chemage.plugin.Barriers):
    """Barriers with two publications, of which one has an entry."""

    kind = "cited"
    cite = ("A. One, J. Phys. 1, 2 (2001)", "B. Two & C. Three, 50 % of {it} (2002), doi:10.1000/a_b.")
    bibtex = (ENTRY, "")

    def quantile(self, u):
        return u

    def density(self, energy):
        return energy


class Derived(Cited):
    """With a publication of its own."""

    kind = "derived"
    cite = ("D. Four (2004)",)


def keys(text):
    return re.findall(r"^@\w+\{(.*),$", text, re.MULTILINE)


def test_a_component_gives_its_entry_and_other_texts_are_notes():
    made = bibtex(references(Cited.cite, [Cited()], "1.2.3"))
    assert keys(made) == ["chemage", "li2018", "someone2001", "two2002"]
    assert "note = {Software, version 1.2.3}" in made
    assert "title = {A {B} C}" in made
    assert (
        r"note = {B. Two \& C. Three, 50 \% of \textbraceleft{}it\textbraceright{} (2002), doi:10.1000/a\_b.}" in made
    )
    assert "doi = {10.1000/a_b}" in made
    for entry in made.split("\n\n"):
        assert bibtex_problem(entry) == ""


def test_a_class_with_its_own_texts_does_not_inherit_entries():
    assert entries_of(Derived) == {}
    assert entries_of(Cited) == {Cited.cite[0]: ENTRY, Cited.cite[1]: ""}


def test_keys_are_unique():
    texts = ["A. Li, x (2018)", "B. Li, y (2018)", "C. Li, z (2018)", "nothing", "nothing else"]
    found = keys(bibtex(references(texts, [])))
    assert len({key.lower() for key in found}) == len(found) == 7
    assert found[1:5] == ["li2018", "li2018b", "li2018c", "li2018d"]


def test_texts_that_are_stated_twice_are_listed_once():
    assert len(references(["a (1999)", "a (1999)"], [])) == 3


@pytest.mark.parametrize(
    ("words", "written"),
    [
        ("Röttger, Šmíd & Åse", r"Röttger, Šmíd \& Åse"),
        ("a_b^c~d #1 $x$", r"a\_b\textasciicircum{}c\textasciitilde{}d \#1 \$x\$"),
        ("1–2\nnext\\", r"1–2 next\textbackslash{}"),
        ("北京", "北京"),
    ],
)
def test_text_is_escaped_for_latex(words, written):
    assert latex(words) == written


@pytest.mark.parametrize(
    "entry", ["", "Hertz (1881)", "@article{a, title = {x}", "@article{a, title = {x}}}", "@book{}"]
)
def test_what_is_no_entry_is_found(entry):
    assert bibtex_problem(entry)


def test_every_publication_of_a_built_in_component_has_an_entry():
    own = registry.current()
    records = [record for record in own.records if record.distribution == "chemage"]
    classes = [own.component(role, kind) for one in records for role, kinds in one.kinds.items() for kind in kinds]
    cited = {text: cls for cls in classes for text in cls.cite}
    assert len(cited) > 12
    made = bibtex(references(cited, classes))
    assert "@misc" not in made.replace("@misc{chemage,", "")
    assert len(set(keys(made))) == len(keys(made)) == len(cited) + 1
    assert all(field in made for field in ("10.1103/PhysRevLett.109.186102", "10.1016/S0043-1648(99)00113-1"))


@pytest.mark.long
def test_cite_of_files_and_scenes(command, tmp_path, small_text, examples):
    (tmp_path / "small.toml").write_text(small_text)
    run = chemage.run(chemage.load_scene(tmp_path / "small.toml"))
    chemage.write(tmp_path / "run.h5", run)
    chemage.write(tmp_path / "ageing.h5", run.ageing)
    chemage.write(tmp_path / "surface.h5", run.surface)
    chemage.write(tmp_path / "history.h5", examples.history())
    of_run = keys(command("cite", tmp_path / "run.h5").out)
    assert of_run[:2] == ["chemage", "li2018"]
    assert "polonsky1999" in of_run
    assert set(keys(command("cite", tmp_path / "small.toml").out)) == set(of_run)
    assert set(keys(command("cite", tmp_path / "ageing.h5").out)) == set(of_run)
    assert "jacobs2017" in keys(command("cite", tmp_path / "surface.h5").out)
    assert keys(command("cite", tmp_path / "history.h5").out) == ["chemage", "li2018"]
    assert "johnson1985" in keys(command("cite", "silica-tip").out)
    assert "--format xml: choose bibtex or text" in command("cite", "silica-tip", "--format", "xml").err
    assert command("cite", "nothing").status == 2
