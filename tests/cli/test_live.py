"""`chemage live`: the page's numbers are those of `chemage run`, in a browser, from a file and in Python."""

import base64
import html
import json
import re
import shlex
import socket
import sys
import tomllib
import urllib.error
import urllib.request

import pytest
import tomli_w

import chemage as ca
from chemage.plugin import options, override, scene_data, statistics
from chemage_live.model import LiveScene, table
from chemage_live.page import Page
from chemage_live.sliders import sliders_of

#: small, and quick to age
FEW = {"hold.replicas": 5, "hold.stop": "1 s", "hold.temperature": "290 K"}
SLIDE = "contact.load=20 nN, 80 nN"


@pytest.fixture(scope="module")
def page():
    return Page("silica-tip", slide=[SLIDE], changes=FEW, in_file=True)


def cells(scene, **changes):
    """The rows of a run, as they stand in the page's table."""
    run = ca.run(override(scene_data(scene)[0], FEW | changes), warn=False)
    return table([run])


def has(place, text):
    """JavaScript: whether the page has this HTML at a place."""
    return f"""(() => {{
      const one = document.createElement("div")
      one.innerHTML = {json.dumps(text)}
      return document.getElementById("{place}").innerHTML == one.innerHTML
    }})()"""


def test_without_words_load_temperature_and_radius_move_about_the_scenes_own_values():
    base = scene_data("silica-tip")[0]
    found = sliders_of(ca.parse_scene(base), (), 9)
    assert [one.path for one in found] == ["contact.load", "hold.temperature", "surface.radius"]
    own = {one.path: one.values[one.start] for one in found}
    assert own == {"contact.load": "50 nN", "hold.temperature": "300 K", "surface.radius": "30 nm"}
    assert "radius of curvature" in found[2].meaning
    for one in found:
        for value in (one.values[0], one.values[-1]):
            ca.parse_scene(override(base, {one.path: value}))


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ("contact.lod", "is no number of this scene"),
        ("contact.kind", "is no number of this scene"),
        ("contact.load=1 nN", "is no range; write"),
        ("contact.load=9 nN, 3 nN", "is no range"),
        ("contact.load=1 nm, 3 nN", "nm"),
    ],
)
def test_a_wrong_slider_is_refused_with_the_remedy(asked, words):
    with pytest.raises(ca.InputError, match=words):
        Page("silica-tip", slide=[asked])


def test_numbers_are_those_of_a_run_and_less_is_said_while_moving(page):
    place = len(page.sliders[0].values) - 1
    assert page.state([place])["table"] == cells("silica-tip", **{"contact.load": "80 nN"})
    model = LiveScene(override(scene_data("silica-tip")[0], {"hold.stop": "1 s"}))
    load = {"contact.load": "80 nN"}
    assert model.at(load, quick=True) == ""
    whole, sites = model.last, model.last.ageing.sites.mean()
    less = model.at(load, quick=True)
    assert less == f"{int(1200 / sites)} of 200 replicas"
    assert model.at(load) == ""
    assert model.last.ageing.replicas == whole.ageing.replicas == 200
    again = model.last
    assert model.at(load) == ""
    assert model.last is again


def test_while_moving_a_large_contact_has_larger_pixels_and_the_same_sites():
    data = override(
        scene_data("silica-rough")[0],
        {"surface.pixels": 1250, "surface.zeta": 75, "hold.replicas": 2, "hold.stop": "1 s"},
    )
    model = LiveScene(data)
    assert model.at({}, quick=True) == "pixels 2 times larger"
    assert model.last.contact.shape == (625, 625)
    sites = model.last.ageing.sites.mean()
    assert model.at({}) == ""
    assert model.last.contact.shape == (1250, 1250)
    assert sites == pytest.approx(model.last.ageing.sites.mean(), rel=0.05)


def test_a_scene_that_is_refused_keeps_what_there_is():
    page = Page("silica-tip", slide=["hold.temperature=300 K, 3000 K"], changes=FEW | {"hold.temperature": "300 K"})
    page.scenes[0].data["hold"]["temperature"] = "300 K"
    page.sliders[0].values[-1] = "-5 K"
    state = page.state([len(page.sliders[0].values) - 1])
    assert set(state) == {"words"}
    assert "temperature" in state["words"]


@pytest.mark.parametrize("equal_pressure", [False, True])
def test_another_scene_follows_at_equal_load_or_equal_mean_pressure(equal_pressure):
    rough = "silica-patch"
    page = Page("silica-tip", rough, slide=[SLIDE], changes=FEW, equal_pressure=equal_pressure, in_file=True)
    page.scenes[1].data["hold"]["replicas"] = 2
    page.state([0])
    first, second = (scene.last.contact for scene in page.scenes)
    if equal_pressure:
        assert second.mean_contact_pressure == pytest.approx(first.mean_contact_pressure, rel=0.02)
    else:
        assert second.load == pytest.approx(first.load)


def test_another_scene_follows_the_sliders_that_it_has_and_always_has_the_load():
    page = Page("silica-tip", "silica-patch", changes=FEW)
    page.scenes[1].data["hold"]["replicas"] = 2
    assert [slider.path for slider in page.sliders] == ["contact.load", "hold.temperature", "surface.radius"]
    state = page.state([slider.start for slider in page.sliders], quick=True)
    assert {"silica-tip", "silica-patch"} < set(state["columns"])
    still = Page("silica-tip", "silica-patch", slide=["surface.radius"], changes=FEW)
    first, second = (scene.last.contact for scene in still.scenes)
    assert second.load == pytest.approx(first.load)


def test_a_file_moves_in_a_browser_by_keyboard_alone_without_a_server(page, browser, tmp_path):
    file = tmp_path / "page.html"
    file.write_text(page.html())
    assert file.stat().st_size < 5_000_000
    for width in (400, 1280):
        seen = browser.open(file, width)
        browser.wait("Bokeh.documents[0]?.is_idle")
        assert [url for url in seen["requests"] if not url.startswith(("file:", "data:", "blob:"))] == []
        assert browser.evaluate("document.documentElement.scrollWidth") <= width
    for _ in range(20):
        browser.press("Tab")
        if browser.evaluate(FOCUSED):
            break
    browser.press("End")
    browser.wait(f"{SLIDER}.value == {SLIDER}.max")
    expected = cells("silica-tip", **{"contact.load": "80 nN"})
    browser.wait(has("table", expected))
    command = browser.evaluate("document.getElementById('command').textContent")
    assert command.endswith("--set 'contact.load=80 nN'")
    assert "--set hold.replicas=5" in command
    saved = tomllib.loads(browser.evaluate("document.getElementById('toml').textContent"))
    assert ca.parse_scene(saved) == ca.parse_scene(
        override(scene_data("silica-tip")[0], FEW | {"contact.load": "80 nN"})
    )


SLIDER = "document.getElementById('contact.load')"
FOCUSED = "document.activeElement.type == 'range'"


@pytest.fixture(scope="module")
def served():
    live = Page("silica-tip", slide=[SLIDE], changes=FEW | {"hold.replicas": 60}).serve()
    yield live
    live.stop()


def test_a_server_tells_the_whole_when_the_slider_rests(served, browser):
    seen = browser.open(served.url, 1280)
    browser.wait("Bokeh.documents[0]?.is_idle")
    assert {url.split("/")[2] for url in seen["requests"] if url.startswith("http")} == {served.url.split("/")[2]}
    browser.evaluate(f"{SLIDER}.value = {SLIDER}.max; {SLIDER}.oninput()")
    expected = cells("silica-tip", **{"contact.load": "80 nN", "hold.replicas": 60})
    browser.wait(has("table", expected))
    assert browser.evaluate("document.getElementById('words').textContent") == ""
    browser.wait("document.getElementById('pictures').innerHTML.includes('alt=\"barriers\"')")
    assert browser.evaluate("document.getElementById('pictures').style.opacity") == "1"


def test_measured_points_are_dropped_into_the_page(served, browser, tmp_path):
    file = tmp_path / "afm.csv"
    file.write_text(LOADED)
    browser.open(served.url, 1280)
    browser.wait("Bokeh.documents[0]?.is_idle")
    node = browser.call("Runtime.evaluate", expression="document.getElementById('file')")["result"]["objectId"]
    browser.call("DOM.setFileInputFiles", files=[str(file)], objectId=node)
    browser.wait("Bokeh.documents[0].get_model_by_name('measured/points').data.x.length == 2")
    assert browser.evaluate("Bokeh.documents[0].get_model_by_name('measured/points').data.y") == pytest.approx(
        [0.1, 0.2]
    )


def test_it_is_found_on_this_machine_alone_by_who_knows_the_address(served):
    root, _, secret = served.url.rpartition("/")
    assert len(secret) >= 20
    for url in (root, f"{root}/", f"{root}/live"):
        with pytest.raises(urllib.error.HTTPError, match="404"):
            urllib.request.urlopen(url)
    port = int(root.rpartition(":")[2])
    others = {info[4][0] for info in socket.getaddrinfo(socket.gethostname(), None, socket.AF_INET)} - {
        "127.0.0.1",
        "127.0.1.1",
    }
    for address in others:
        with pytest.raises(OSError), socket.create_connection((address, port), 2):
            pass


def test_a_taken_port_is_named(served, command):
    port = served.url.split(":")[2].partition("/")[0]
    told = command("live", "silica-tip", "--port", port, "--no-browser")
    assert told.status != 0
    assert f"port = {port}: is not free" in told.err


LOADED = "hold_time (s),friction_drop (nN),error,load (nN)\n1,2,0.1,20\n10,4,0.1,20\n"


def test_measured_points_are_drawn_as_what_is_shown_or_what_is_wrong_is_said(page):
    def dropped(text):
        return page.measured("a<b.csv", text.encode())

    found = dropped(LOADED)
    points = found["columns"]["measured/points"]
    # at the load of the measurement, wherever the slider is
    assert list(points["y"]) == pytest.approx([2 / 20, 4 / 20])
    assert points["high"][0] == pytest.approx((2 + statistics.NORMAL_LIMIT * 0.1) / 20)
    assert found["words"] == ""
    without = dropped("hold_time (s),friction_drop (nN),error\n1,2,0.1\n10,4,0.1\n")
    assert "give the load of the measurement" in without["words"]
    assert html.escape("a<b.csv") in dropped("nothing\n")["words"]


def test_a_file_has_less_unless_all_is_asked_for(tmp_path, command):
    for words, least in (((), False), (("--full",), True)):
        file = tmp_path / "page.html"
        told = command("live", "silica-tip", "--set", "hold.stop=1 s", "--slide", SLIDE, "-o", file, "--force", *words)
        assert told.status == 0, told.err
        states = json.loads(re.search(r'id="states">(.*?)</script>', file.read_text(), re.DOTALL)[1])
        said = [state["words"] for state in states]
        assert ("of 200 replicas" in " ".join(said)) != least
        assert ("--full" in told.out) != least


def test_a_missing_extra_is_named_with_the_command_that_installs_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "bokeh", None)
    with pytest.raises(ca.ChemageError, match=r"pip install 'chemage\[live\]'"):
        ca.live("silica-tip")


def test_too_many_results_are_refused_with_the_remedy(tmp_path, command):
    slide = ["contact.load", "surface.radius", "hold.temperature", "chemistry.bond_force"]
    page = Page("silica-tip", slide=slide, in_file=True)
    with pytest.raises(ca.InputError, match="choose fewer sliders"):
        page.html()
    told = command("live", "silica-tip", "-o", tmp_path / "page.txt")
    assert told.status != 0
    assert ".html" in told.err


def test_the_command_writes_a_page(tmp_path, command):
    file = tmp_path / "page.html"
    told = command("live", "silica-tip", "--set", "hold.replicas=2", "--slide", SLIDE, "-o", file)
    assert told.status == 0, told.err
    assert "hold.replicas=2" in file.read_text()
    cost = re.search(r"^(\d+) results: about \d+ s; --full: with all pixels and replicas$", told.out, re.MULTILINE)
    assert cost
    assert told.out.index(cost[0]) < told.out.index("page ")
    again = command("live", "silica-tip", "-o", file)
    assert again.status != 0
    assert "--force" in again.err


def test_the_command_says_values_as_toml_and_names_the_saved_file_of_a_sweep():
    data = scene_data("silica-tip")[0]
    page = Page("silica-tip", slide=[SLIDE], changes={"contact.gap": True, "hold.replicas": 5})
    assert page.command({}) == "chemage run silica-tip --set contact.gap=true --set hold.replicas=5"
    swept = Page({**data, "sweep": {"contact.load": ["10 nN", "20 nN"]}}, slide=[SLIDE])
    assert swept.command({}) == "chemage run live.toml"


def test_the_command_is_one_line_that_a_shell_reads_and_gives_the_same_scene(tmp_path):
    file = tmp_path / "my 'own' scene; $(x).toml"
    file.write_text(tomli_w.dumps(scene_data("silica-tip")[0]))
    changes = {"name": "true", "title": 'it\'s "mine"', "hold.replicas": 2, "hold.stop": "1 s"}
    page = Page(file, slide=[SLIDE], changes=changes)
    program, run, scene, *words = shlex.split(page.command({"contact.load": "20 nN"}))
    assert (program, run, scene) == ("chemage", "run", str(file))
    assert set(words[::2]) == {"--set"}
    read = options.changed_fields(words[1::2])
    assert read == {**changes, "contact.load": "20 nN"}


@pytest.mark.parametrize("name", ["measured points", "silica-tip: contact pressure (GPa)"])
def test_a_scene_may_have_the_name_of_anything_on_the_page(name):
    page = Page("silica-tip", slide=[SLIDE], changes={**FEW, "name": name})
    shown = [*page.state([0])["columns"], *page.measured("afm.csv", LOADED.encode())["columns"]]
    assert len(shown) == len(set(shown)) == 3
    names = re.findall(r'"name":"([^"]*)"', page._html())
    assert [names.count(each) for each in shown] == [1, 1, 1]


MALFORMED = [
    b"",
    b"{",
    b"[]",
    b"\xff",
    b"{}",
    b'{"places": [0]}',
    b'{"places": [-1], "step": "moving"}',
    b'{"places": [1000], "step": "moving"}',
    b'{"places": [0, 0], "step": "moving"}',
    b'{"places": [], "step": "moving"}',
    b'{"places": [true], "step": "moving"}',
    b'{"places": ["0"], "step": "moving"}',
    b'{"places": [0.5], "step": "moving"}',
    b'{"places": [0], "step": "sleeping"}',
    b'{"places": [0], "step": "moving", "more": 1}',
    b'{"name": "a.csv", "content": 3}',
    b'{"name": "a.csv", "content": "a"}',
    b'{"name": 1, "content": ""}',
    b'{"content": ""}',
]


@pytest.mark.parametrize("body", MALFORMED)
def test_a_malformed_request_is_refused_in_words(served, caplog, body):
    with pytest.raises(urllib.error.HTTPError) as refused:
        urllib.request.urlopen(urllib.request.Request(served.url, data=body))
    assert refused.value.code == 400
    assert json.loads(refused.value.read())["words"]
    assert not [record for record in caplog.records if record.exc_info]


def test_a_request_that_is_none_of_ours_leaves_the_server_at_work(served):
    odd = {"name": "../a\0b.x\0/y", "content": base64.b64encode(b"1").decode()}
    for body in (odd, {"places": [0], "step": "moving"}):
        request = urllib.request.Request(served.url, data=json.dumps(body).encode())
        assert urllib.request.urlopen(request).status == 200


def test_a_scene_without_ageing_has_nothing_to_play_with():
    data = {
        name: section for name, section in scene_data("silica-tip")[0].items() if name in ("name", "surface", "contact")
    }
    with pytest.raises(ca.InputError, match="ages nothing"):
        Page(data, slide=[SLIDE])


def test_a_notebook_shows_it():
    live = ca.live("silica-tip", slide=[SLIDE])
    shown = live._repr_html_()
    assert f'src="{live.url}"' in shown
    assert live.url.startswith("http://localhost:")
    assert live._repr_html_() == shown
    live.stop()
    live.thread.join(20)
    assert not live.thread.is_alive()
    port = int(live.url.split(":")[2].partition("/")[0])
    with pytest.raises(ConnectionRefusedError), socket.create_connection(("127.0.0.1", port), 2):
        pass
