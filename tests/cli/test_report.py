"""``chemage report``, looked at in a real browser: on a desk, on a phone, in the dark and on paper."""

from __future__ import annotations

import subprocess

import pytest

TITLE = "Rough & <b>ready</b> contact"
TABLE = (
    "hold_time (s), friction_coefficient_drop, error\n1,0.2,0.05\n10,0.8,0.05\n100,1.5,0.05\n1e3,2.2,0.1\n1e4,2.7,0.1\n"
)


@pytest.fixture(scope="module")
def made():
    """File name -> content, of what :func:`page` made the first time."""
    return {}


@pytest.fixture
def page(small, command, made):
    """A report of two results with measurements, made by the command line."""
    folder = small.parent
    small.write_text(small.read_text().replace("A small rough contact", TITLE))
    (folder / "afm.csv").write_text(TABLE, encoding="utf-8")
    if not made:
        for load in (40, 80):
            words = ("--no-figures", "--out", f"at{load}.h5", "--set", f"contact.load={load}")
            assert command("run", small, *words).status == 0
        done = command("report", "at40.h5", "at80.h5", "--measured", "afm.csv")
        assert done.status == 0, done.err
        assert done.out == "report.html\n"
        made |= {path.name: path.read_bytes() for path in folder.iterdir()}
    for name, content in made.items():
        (folder / name).write_bytes(content)
    return folder / "report.html"


@pytest.mark.long
def test_the_page_works_in_a_browser_at_every_width_and_in_the_dark(page, browser, tmp_path):
    colours = {}
    for width, dark in ((1280, False), (360, True), (768, False)):
        seen = browser.open(page, width, dark=dark)
        assert seen["complaints"] == []
        assert [url for url in seen["requests"] if not url.startswith("data:")] == [page.as_uri()]
        assert seen["width"] == width
        assert seen["scrollWidth"] <= width, seen["wide"]
        assert seen["wide"] == []
        assert len(seen["images"]) == 6
        for complete, pixels, alt in seen["images"]:
            assert complete
            assert pixels > 400
            assert alt
        assert len(seen["drawings"]) == 15
        for wide, high, label, paths in seen["drawings"]:
            assert 250 < wide <= width
            assert high > 150
            assert label
            assert paths > 20
        assert seen["broken"] == []
        tags = [tag for tag, _ in seen["headings"]]
        assert tags.count("H1") == 1
        assert tags[:2] == ["H1", "H2"]
        titles = [text for _, text in seen["headings"]]
        assert "Comparison" in titles
        assert "at40: small: self-affine at 40 nN" in titles
        assert "References" in titles
        for text in ("Chemistry: the same in all results.", "40 nN", "80 nN", "afm", "log10(1 + t/t_c)"):
            assert text in seen["text"], text
        colours[dark] = seen["colours"]
        browser.screenshot(tmp_path / f"{width}-{dark}.png")
        assert (tmp_path / f"{width}-{dark}.png").stat().st_size > 50_000
    (ink, paper), (ink_dark, paper_dark) = (
        [sum(map(int, colour[4:-1].split(","))) for colour in colours[dark]] for dark in (False, True)
    )
    assert ink < 150 < 700 < paper
    assert paper_dark < 150 < 600 < ink_dark


@pytest.mark.long
def test_curves_take_the_colour_of_the_page(page, browser):
    """Axes drawn in black would vanish at night."""
    for dark, lowest, highest in ((False, 0, 60), (True, 200, 255)):
        browser.open(page, 1280, dark=dark)
        strokes = browser.evaluate(
            "[...document.querySelectorAll('svg path')].map(p => getComputedStyle(p).stroke)"
            ".filter(s => s.startsWith('rgb')).map(s => s.match(/\\d+/g).map(Number))"
        )
        frames = [stroke for stroke in strokes if max(stroke[:3]) - min(stroke[:3]) < 15]
        assert len(frames) > 50
        near = [stroke for stroke in frames if lowest <= sum(stroke[:3]) / 3 <= highest]
        assert len(near) > 0.8 * len(frames)


@pytest.mark.long
def test_a_wide_table_scrolls_in_a_box_that_the_keyboard_reaches(page, browser):
    browser.open(page, 360)
    boxes = browser.evaluate(
        "[...document.querySelectorAll('.scroll')].map(b => [b.scrollWidth > b.clientWidth, b.tabIndex,"
        " b.getAttribute('role'), b.getAttribute('aria-label'), b.clientWidth])"
    )
    assert any(scrolls for scrolls, *_ in boxes)
    for _, tab, role, label, width in boxes:
        assert (tab, role) == (0, "region")
        assert label
        assert width <= 360


@pytest.mark.long
def test_links_of_the_contents_lead_to_their_sections(page, browser):
    browser.open(page, 800)
    for target in browser.evaluate("[...document.querySelectorAll('nav a')].map(a => a.getAttribute('href'))"):
        browser.evaluate(f"document.querySelector('nav a[href=\"{target}\"]').click()")
        top = browser.evaluate(f"document.querySelector('{target}').getBoundingClientRect().top")
        last = browser.evaluate("innerHeight + scrollY >= document.documentElement.scrollHeight - 2")
        assert abs(top) < 60 or last


@pytest.mark.long
def test_on_paper_it_is_dark_on_white_and_complete(page, browser):
    seen = browser.open(page, 800, dark=True, media="print")
    assert seen["colours"] == ["rgb(0, 0, 0)", "rgb(255, 255, 255)"]
    assert browser.evaluate("getComputedStyle(document.querySelector('nav')).display") == "none"
    assert browser.evaluate("getComputedStyle(document.querySelector('.scroll')).overflowX") == "visible"
    pdf = browser.pdf()
    assert pdf.startswith(b"%PDF-")
    assert pdf.count(b"/Type /Page\n") + pdf.count(b"/Type /Page ") >= 4


@pytest.mark.long
def test_a_browser_without_a_window_shows_the_same(page, tmp_path, browser_words):
    """The page as any reader opens it, without the tools of developers: its elements and its picture."""
    dump = subprocess.run(
        [*browser_words, f"--user-data-dir={tmp_path / 'a'}", "--dump-dom", page.as_uri()],
        capture_output=True, text=True, timeout=300, check=True,
    )  # fmt: skip
    assert "<h1>Comparison of 2 results</h1>" in dump.stdout
    assert dump.stdout.count("<svg ") == 15
    assert dump.stdout.rstrip().endswith("</html>")
    shot = tmp_path / "shot.png"
    subprocess.run(
        [*browser_words, f"--user-data-dir={tmp_path / 'b'}", f"--screenshot={shot}", page.as_uri()],
        capture_output=True, timeout=300, check=True,
    )  # fmt: skip
    assert shot.read_bytes().startswith(b"\x89PNG")
    assert shot.stat().st_size > 20_000


# -- the command ------------------------------------------------------------------------------------------------------


@pytest.fixture
def existing(small, command):
    """A page in whose folder there is the result ``at40.h5``."""
    done = command("run", small, "--no-figures", "--out", "at40.h5")
    assert done.status == 0, done.err
    page = small.parent / "report.html"
    page.write_text("mine")
    return page


@pytest.mark.long
def test_an_existing_page_is_kept_unless_forced(existing, command):
    page, first = existing, existing.read_bytes()
    done = command("report", "at40.h5")
    assert done.status == 2
    assert "already there" in done.err
    assert page.read_bytes() == first
    assert command("report", "at40.h5", "--force").status == 0
    assert page.read_bytes().startswith(b"<!DOCTYPE html>")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("at40.h5", "--out", "at40.h5", "--force"), "an input of this report"),
        (("nowhere.h5", "--out", "new.html"), "nowhere.h5 does not exist"),
        (("at40.h5", "--out", "no/new.html"), "does not exist; create it first"),
        (("at40.h5", "--measured", "small.toml", "--out", "new.html"), "small.toml, line"),
    ],
)
def test_user_errors_are_one_message_and_leave_nothing(existing, command, words, message):
    before = sorted(path.name for path in existing.parent.iterdir())
    done = command("report", *words)
    assert done.status == 2
    assert message in done.err
    assert "Traceback" not in done.err
    assert sorted(path.name for path in existing.parent.iterdir()) == before
