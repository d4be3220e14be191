"""The page as text: everything inside it, nothing from outside, what users wrote shown and never obeyed."""

from __future__ import annotations

import os
import re
from html.parser import HTMLParser

import numpy as np
import pytest
from seen import report

import chemage as ca
from chemage import InputError, parse_scene, write_report
from chemage.plugin import StoreError, override

BASE = {
    "name": "tip",
    "title": "Tips & <script>alert('x')</script> \"quoted\" $x$",
    "surface": {"kind": "sphere", "radius": "20 nm", "pixels": 32, "pixel_size": "0.4518 nm"},
    "contact": {"kind": "hertz", "modulus": "35.3 GPa", "load": "30 nN"},
    "forming": {"kind": "md-silica"},
    "interaction": {"kind": "elastic-pairs", "strength": "0.1 eV", "bias": 0.1},
    "engine": {"kind": "rejection-free"},
    "hold": {"start": "0.1 s", "stop": "1e4 s", "per_decade": 2, "replicas": 10, "seed": 7},
    "observe": [{"kind": "barrier-spectrum", "bins": 50}],
}
#: a name that a browser would obey if it were written into the page as it is
ODD = "<img src=x onerror=alert(1)> & 'q'"
VOID = {"meta", "img", "link", "br", "hr", "input"}


class Page(HTMLParser):
    """The elements of a page, and whether every one that opens also closes."""

    def __init__(self, text):
        super().__init__()
        self.elements, self.open, self.problems, self.text = [], [], [], ""
        self.feed(text)
        self.problems += self.open

    def handle_starttag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))

    def handle_endtag(self, tag):
        if not self.open or self.open.pop() != tag:
            self.problems.append(f"</{tag}>")

    def handle_data(self, data):
        if "style" not in self.open:
            self.text += data

    def of(self, tag):
        return [attrs for name, attrs in self.elements if name == tag]


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("files")
    for name, changes in (("tip", {}), (ODD, {"surface.radius": "40 nm", "title": "Big tip"})):
        ca.write(folder / f"{name}.h5", ca.run(parse_scene(override(BASE, changes)), threads=1))
    return [folder / "tip.h5", folder / f"{ODD}.h5"]


@pytest.fixture(scope="module")
def one(files):
    return report(files[:1])


@pytest.fixture(scope="module")
def several(files):
    return report(files)


@pytest.mark.long
def test_the_page_is_well_formed_and_says_its_language(one):
    page = Page(one)
    assert page.problems == []
    assert one.startswith("<!DOCTYPE html>")
    assert page.of("html") == [{"lang": "en"}]
    assert {"charset": "utf-8"} in page.of("meta")
    ids = [attrs["id"] for _, attrs in page.elements if "id" in attrs]
    assert len(ids) == len(set(ids))


def test_nothing_comes_from_outside(one):
    page = Page(one)
    assert re.findall(r"(?:https?:)?//[\w.-]+\.\w+", re.sub(r"base64,[\w+/=]+", "", one)) == []
    for tag, attrs in page.elements:
        assert tag not in ("script", "link", "iframe", "object", "embed", "base", "form"), tag
        for name, value in attrs.items():
            assert not name.startswith("on"), (tag, name)
            if name in ("src", "href", "xlink:href"):
                assert value.startswith(("#", "data:image/png;base64,")), value[:60]
    policy = [attrs["content"] for attrs in page.of("meta") if attrs.get("http-equiv") == "Content-Security-Policy"]
    assert policy
    assert "default-src 'none'" in policy[0]


@pytest.mark.long
def test_what_a_user_wrote_is_shown_and_not_obeyed(one, several):
    assert BASE["title"] in Page(one).text
    assert "<script" not in one
    page = Page(several)
    assert page.problems == []
    assert ODD in page.text
    assert all("onerror" not in attrs for attrs in page.of("img"))


def test_pictures_are_described_and_tables_have_headers(one, files):
    page = Page(one)
    drawings, maps = page.of("svg"), page.of("img")
    assert len(maps) == 2  # heights and pressure; the only patch is not drawn twice
    assert len(drawings) == 5
    for attrs in drawings:
        assert attrs["role"] == "img"
    for words in [attrs["aria-label"] for attrs in drawings] + [attrs["alt"] for attrs in maps]:
        assert len(words) > 20
    # in numbers, for those who do not see the curve
    drop = next(attrs["aria-label"] for attrs in drawings if attrs["aria-label"].startswith("friction drop"))
    run = ca.read(files[0])
    assert f"{run.ageing.mean_friction_drop[-1]:.3g} at 10000 s" in drop
    assert len(page.of("table")) == one.count('<th scope="col"') - one.count('</th><th scope="col"')
    assert {attrs["scope"] for attrs in page.of("th")} == {"col", "row"}


def test_numbers_scene_provenance_and_citations_are_there(one, files):
    run, text = ca.read(files[0]), Page(one).text
    assert run.contact.quantity("area").text() in text
    assert f"{run.ageing.hold_times[3]:.6g}" in text
    for digest in (*run.keys.values(), run.contact.digest(), run.ageing.digest()):
        assert digest in text
    for name, version in run.versions.items():
        assert name in text
        assert version in text
    for cited in run.cite:
        assert cited in text
    assert run.cite
    assert re.search(r"seed of disorder and kinetics\s*7", text)


def test_the_scene_on_the_page_is_a_scene_that_gives_the_same_result(one, files, tmp_path):
    shown = re.search(r"<pre>(.*?)</pre>", one, re.DOTALL)
    assert shown is not None
    again = tmp_path / "again.toml"
    again.write_text(Page(shown[0]).text, encoding="utf-8")
    run = ca.read(files[0])
    assert ca.load_scene(again).keys() == run.keys
    assert ca.load_scene(again).todict() == run.scene


@pytest.mark.long
def test_several_files_are_compared_and_each_has_its_section(several):
    page = Page(several)
    headings = [attrs for tag, attrs in page.elements if tag == "h2"]
    assert len(headings) == 4  # comparison, two results, what to cite
    assert "Chemistry: the same in all results." in page.text
    assert "surface.radius" in page.text
    assert page.problems == []
    ids = [attrs["id"] for _, attrs in page.elements if "id" in attrs]
    assert len(ids) == len(set(ids))
    linked = {attrs["href"][1:] for attrs in page.of("a")}
    assert linked <= set(ids)
    used = {attrs["href"][1:] for attrs in page.of("use")}
    assert used
    assert used <= set(ids)


@pytest.mark.long
def test_the_same_files_give_the_same_bytes(one, files):
    assert report(files[:1]) == one


@pytest.mark.long
def test_measurements_are_fitted_and_shown(files, tmp_path):
    table = tmp_path / "afm.csv"
    rows = "".join(f"{t}, {2 * np.log10(1 + t):.6f}\n" for t in (0.5, 2, 10, 100, 1000, 9000))
    table.write_text(f"hold_time (s), friction_coefficient_drop\n{rows}", encoding="utf-8")
    text = Page(report(files[:1], measured=[table])).text
    assert "Measurements" in text
    assert "Δμ = β log10(1 + t/t_c), 6 points" in text
    assert "2.0000000 ± " in text


@pytest.mark.long
def test_ageing_or_a_contact_alone_make_a_report_too(files, tmp_path):
    run = ca.read(files[0])
    ca.write(tmp_path / "ageing.h5", run.ageing)
    ca.write(tmp_path / "contact.h5", run.contact)
    page = Page(report([tmp_path / "ageing.h5", tmp_path / "contact.h5"]))
    assert page.problems == []
    assert run.ageing.digest() in page.text
    assert run.contact.digest() in page.text


def test_a_contact_that_did_not_converge_says_so_first(files, tmp_path):
    contact = ca.read(files[0]).contact
    bad = contact.fromdict({**contact.todict(), "converged": False, "residual": 0.5, "notes": ("one <b>note</b>",)})
    ca.write(tmp_path / "bad.h5", bad)
    text = Page(report([tmp_path / "bad.h5"])).text
    assert "did NOT converge: residual 0.5" in text
    assert "one <b>note</b>" in text


def test_nothing_is_overwritten_and_nothing_half_written(tmp_path, monkeypatch, examples):
    files = [tmp_path / "one.h5", tmp_path / "two.h5"]
    for number, file in enumerate(files, 1):
        ca.write(file, examples.history(temperature=100.0 * number))
    out = write_report(files[:1], tmp_path / "r.html")
    first = out.read_bytes()
    assert first.startswith(b"<!DOCTYPE html>")
    with pytest.raises(StoreError, match="already there"):
        write_report(files[1:], out)
    assert out.read_bytes() == first
    write_report(files[1:], out, force=True)
    assert out.read_bytes() != first
    for given in files[0], tmp_path / "." / "data.csv":
        with pytest.raises(InputError, match="an input of this report"):
            write_report([files[0]], given, measured=[tmp_path / "data.csv"], force=True)
    with pytest.raises(StoreError, match="does not exist"):
        write_report(files, tmp_path / "no" / "r.html")

    real = os.open

    def full(path, flags, *more):
        handle = real(path, flags, *more)
        if flags & os.O_EXCL:
            os.write(handle, b"half")
            os.close(handle)
            raise OSError(28, "No space left on device")
        return handle

    monkeypatch.setattr(os, "open", full)
    with pytest.raises(StoreError, match="nothing was kept"):
        write_report(files[:1], tmp_path / "full.html")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["one.h5", "r.html", "two.h5"]


def test_the_page_begins_with_the_main_numbers_and_the_curve(one):
    begin = one[one.index("<main>") :]
    assert begin.index("<table") < begin.index("</table>") < begin.index("<svg") < begin.index("<h3>")
    numbers = begin[begin.index("<table") : begin.index("</table>")]
    for what in ("friction coefficient drop Δμ at 10000 s", "ageing rate per decade β", "area fraction A/A0"):
        assert what in numbers
    assert "engine" not in numbers
    assert "friction coefficient drop Δμ against hold time" in begin[begin.index("<svg") : begin.index("<svg") + 400]
