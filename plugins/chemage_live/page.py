"""The page: curves, map, table, sliders; on a server of this machine, in a notebook, or in one file."""

from __future__ import annotations

import itertools
import json
import math
import queue
import secrets
import socket
import tempfile
import threading
from base64 import b64decode
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future
from functools import partial
from html import escape
from pathlib import Path
from typing import Any, Self

import tomli_w
from jinja2 import Template
from matplotlib.colors import to_hex

from chemage import ChemageError, InputError, errors, read_measurements
from chemage.plugin import (
    drawing,
    figures,
    override,
    scene_data,
    statistics,
    write_file,
)
from chemage_live.model import LiveScene, table
from chemage_live.sliders import sliders_of

#: seconds without a move, after which everything is computed
REST = 0.4
#: results and bytes of a file, at most
MOST_STATES, MOST_BYTES = 400, 5_000_000
#: on a server, and in a file: values of a slider, and pixels along a side of a map
ON_SERVER, IN_FILE = (41, 128), (5, 24)
HOST = "127.0.0.1"
#: so that it is as wide as a phone
_TEMPLATE = Template(
    "{% extends base %}{% block preamble %}"
    '<meta name="viewport" content="width=device-width, initial-scale=1">{% endblock %}'
)
#: what a browser does by itself: titles of sliders, the command and the scene of their values
_TITLES = """
const values = view.values.map((values, number) => values[view.sliders[number].value])
for (const [number, slider] of view.sliders.entries()) slider.title = `${slider.name} = ${values[number]}`
const sets = view.sliders.map((slider, number) => ` --set '${slider.name}=${values[number]}'`)
view.command.text = view.run + sets.join("")
view.command.tags = [view.toml.replace(/"@@(\\d+)@@"/g, (_, number) => JSON.stringify(values[+number]))]
"""
_STATES = """
const state = states[view.sliders.reduce((sum, slider) => sum * (slider.end + 1) + slider.value, 0)]
for (const [name, values] of Object.entries(state))
    if (name in view.sources) view.sources[name].data = values
    else view[name].text = values
"""
_SAVE = """
const link = document.createElement("a")
link.href = URL.createObjectURL(new Blob([view.command.tags[0]], {type: "application/toml"}))
link.download = "live.toml"
link.click()
"""
_WIDE = "stretch_width"


class Page:
    """A page with a scene's options on sliders. A notebook shows it; :meth:`serve` and :meth:`html` give it to browsers.

    Parameters
    ----------
    scene
        A scene file, the name of an installed scene, or plain data.
    beside
        Another scene, whose options of the same names follow the same sliders.
    slide
        Options to move, each ``"PATH"`` or ``"PATH=LOW, HIGH"``; default: load, temperature, radius and rms slope.
    changes
        Of the scene: dotted path -> value.
    equal_pressure
        Whether ``beside`` is pressed to the same mean contact pressure, instead of with the same load.
    in_file
        Whether sliders have as few values as one file holds.

    Raises
    ------
    InputError
        An option is no number of the scene.
    MissingError
        bokeh is not installed: ``pip install 'chemage[live]'``.
    """

    loop: Any

    def __init__(
        self,
        scene: str | Path | Mapping[str, Any],
        beside: str | Path | None = None,
        *,
        slide: Sequence[str] = (),
        changes: Mapping[str, Any] | None = None,
        equal_pressure: bool = False,
        in_file: bool = False,
    ) -> None:
        errors.optional_module("bokeh", "live")
        count, self.map_pixels = IN_FILE if in_file else ON_SERVER
        data = scene if isinstance(scene, Mapping) else scene_data(scene)[0]
        # a scene that is no file, or a sweep, is repeated from the file that the button saves
        saved = data is scene or "sweep" in data
        self.where = "live.toml" if saved else str(scene)
        base = override(data, {"sweep": None, **(changes or {})})
        self.sliders = sliders_of(base, slide, count)
        self.models = [LiveScene(base, self.sliders)]
        if beside is not None:
            other = override(scene_data(beside)[0], {"sweep": None})
            if other["name"] == base["name"]:
                other["name"] += " beside"
            self.models.append(LiveScene(other, self.sliders))
        self.equal_pressure = equal_pressure
        self.command = f"chemage run {self.where}"
        for path, value in (changes or {}).items():
            said = value if isinstance(value, str) else json.dumps(value)
            self.command += f" --set '{path}={said}'"
        #: where it is served
        self.url = ""
        #: the places of the scene's own values
        self.starts = [slider.start for slider in self.sliders]
        # of the pages that are open, one computes
        self._lock = threading.Lock()

    def state(self, places: Sequence[int], quick: bool = False) -> dict[str, Any]:
        """What is shown at these places, by the names of sources and of words; the second scene at the load, or the mean
        pressure, of the first. Of an error of a scene there are its words alone."""
        with self._lock:
            try:
                less = load = ""
                for model in self.models:
                    less = model.at(places, quick, load) or less
                    if self.equal_pressure:
                        pressure = model.last.contact.mean_contact_pressure
                        load = f"{pressure!r} GPa over contact"
            except ChemageError as error:
                return {"words": escape(str(error))}
            state: dict[str, Any] = {
                "words": less and f"While you move: {less}.",
                "table": table([model.shown for model in self.models]),
            }
            for model in self.models:
                state[model.name] = model.columns()
                if (blocks := model.pressure(self.map_pixels)) is not None:
                    state[f"{model.name}: contact pressure (GPa)"] = blocks
            return state

    def check(self) -> None:
        """Compute the scenes' own values, so that what is wrong with them is said here and not in a browser.

        Raises
        ------
        ChemageError
            As of any run, or a scene ages nothing.
        """
        for model in self.models:
            model.at(self.starts, quick=True)

    def fill(self, document: Any, state: Mapping[str, Any]) -> dict[str, Any]:
        """Lay the page out in ``document``, showing ``state``; return by name what moves."""
        from bokeh import layouts
        from bokeh import models as widgets
        from bokeh.plotting import figure

        curve = self.models[0].curve
        plot: Any = figure(
            x_axis_type="log",
            x_axis_label=curve.axis_of.axis,
            y_axis_label=curve.axis,
            height=340,
            sizing_mode=_WIDE,
        )
        sources: dict[str, Any] = {
            name: widgets.ColumnDataSource(dict(values), name=name)
            for name, values in state.items()
            if not isinstance(values, str)
        }
        colours = iter(figures.PALETTE)
        plots = [plot]
        for name, source in sources.items():
            if "image" in source.data:
                plots.append(_map(source, name))
                continue
            of = {"source": source, "color": next(colours), "legend_label": name}
            plot.varea("x", "low", "high", alpha=0.2, **of)
            plot.line("x", "y", width=2, **of)
        points = widgets.ColumnDataSource({"x": [], "y": [], "low": [], "high": []})
        plot.segment("x", "low", "x", "high", source=points, color="black")
        plot.scatter("x", "y", source=points, color="black", size=5)
        plot.legend.location = "top_left"
        marks = {one.path: f"@@{at}@@" for at, one in enumerate(self.sliders)}
        view: dict[str, Any] = {
            "sliders": [
                widgets.Slider(
                    start=0,
                    end=len(one.values) - 1,
                    value=one.start,
                    step=1,
                    show_value=False,
                    name=one.path,
                    sizing_mode=_WIDE,
                )
                for one in self.sliders
            ],
            "values": [list(one.values) for one in self.sliders],
            "sources": sources,
            "points": points,
            "words": widgets.Div(text=state["words"], name="words", min_height=20),
            "table": widgets.Div(
                text=state["table"], name="table", min_width=280, sizing_mode=_WIDE
            ),
            "pictures": widgets.Div(
                name="pictures",
                stylesheets=["img {max-width: 100%; height: auto}"],
                sizing_mode=_WIDE,
            ),
            "command": widgets.PreText(
                name="command",
                stylesheets=[
                    "pre {white-space: pre-wrap; overflow-wrap: anywhere}"
                ],
                sizing_mode=_WIDE,
            ),
            "toml": tomli_w.dumps(override(self.models[0].data, marks)),
            "run": self.command,
        }
        args = {"view": view}
        titles = widgets.CustomJS(args=args, code=_TITLES)
        document.js_on_event("document_ready", titles)
        for slider in view["sliders"]:
            slider.js_on_change("value", titles)
        save = widgets.Button(label="Save this scene as TOML")
        save.js_on_click(widgets.CustomJS(args=args, code=_SAVE))
        view["measured"] = widgets.FileInput(title="measured points")
        meanings = "".join(
            f"<dt>{one.path}<dd>{escape(one.meaning)}" for one in self.sliders
        )
        moved = [
            *view["sliders"],
            view["measured"],
            save,
            view["command"],
            widgets.Div(text=f"<dl>{meanings}</dl>", sizing_mode=_WIDE),
        ]
        columns = [
            layouts.column(*parts, min_width=300, sizing_mode=_WIDE)
            for parts in (moved, [view["words"], *plots], [view["table"]])
        ]
        wrapped = {"flex-wrap": "wrap"}
        document.add_root(layouts.row(*columns, styles=wrapped, sizing_mode=_WIDE))
        document.add_root(view["pictures"])
        document.title = f"chemage live: {self.where}"
        document.template = _TEMPLATE
        return view

    def follow(self, document: Any) -> None:
        """Fill a ``document`` of a server and follow its sliders until it is closed."""
        view = self.fill(document, self.state(self.starts, quick=True))
        moves: queue.SimpleQueue[list[int] | None] = queue.SimpleQueue()

        def moved(attr: str, old: int, new: int) -> None:
            moves.put([slider.value for slider in view["sliders"]])

        def show(state: Mapping[str, Any], opacity: str) -> None:
            view["pictures"].styles = {"opacity": opacity}
            for name, values in state.items():
                if name in view["sources"]:
                    view["sources"][name].data = values
                else:
                    view[name].text = values

        def tell(places: Sequence[int], quick: bool) -> None:
            state = self.state(places, quick)
            document.add_next_tick_callback(partial(show, state, "0.3"))
            if not quick and moves.empty() and "table" in state:
                drawn = {"pictures": self._drawn()}
                document.add_next_tick_callback(partial(show, drawn, "1"))

        for slider in view["sliders"]:
            slider.on_change("value", moved)
        view["measured"].on_change(
            "value", lambda attr, old, new: self.measured(view)
        )
        document.on_session_destroyed(lambda _: moves.put(None))
        threading.Thread(target=_compute, args=(moves, tell), daemon=True).start()
        moves.put(self.starts)

    def _drawn(self) -> str:
        """All pictures of the first scene, as they are printed."""
        with self._lock:
            drawn = drawing.figures(self.models[0].last).items()
            return "".join(figures.png(one, name) for name, one in drawn)

    def measured(self, view: Mapping[str, Any]) -> None:
        """Draw the points of the table in ``view["measured"]``, or say what is wrong with it."""
        given = view["measured"]
        try:
            with tempfile.TemporaryDirectory() as folder:
                file = Path(folder) / f"measured{Path(given.filename).suffix}"
                write_file(file, b64decode(given.value))
                read = read_measurements(file)
            name: Any = self.models[0].curve.name
            # at the load of the measurement: that of the slider moves
            shown = read.as_quantity(name, None)
            if shown is None:
                problem = f"is not {name}; give the load of the measurement"
                raise InputError.of("quantity", read.quantity, problem)
        except ChemageError as error:
            view["words"].text = escape(f"{given.filename}: {error}")
            return
        error = (
            0.0 if shown.error is None else statistics.NORMAL_LIMIT * shown.error
        )
        ends = {"low": shown.values - error, "high": shown.values + error}
        view["points"].data = {"x": shown.hold_times, "y": shown.values, **ends}

    def serve(self, port: int = 0) -> Self:
        """Serve it from now on, to this machine alone, at the secret address ``url``.

        Raises
        ------
        InputError
            The port is taken, or the scene ages nothing.
        """
        from bokeh.server.server import Server
        from tornado.ioloop import IOLoop

        with socket.socket() as probe:
            try:
                probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                probe.bind((HOST, port))
            except OSError as error:
                problem = f"is not free ({error.strerror})"
                remedy = "choose another, or 0 for any"
                raise InputError.of("port", port, problem, remedy) from None
        self.check()
        where = f"/{secrets.token_urlsafe(16)}"
        started: Future[Any] = Future()

        def serve() -> None:
            self.loop = IOLoop()
            pages = {where: self.follow}
            how: Any = {"address": HOST, "port": port, "use_index": False}
            server = Server(pages, io_loop=self.loop, **how)
            server.start()
            started.set_result(server.port)
            self.loop.start()

        self.thread = threading.Thread(target=serve, daemon=True)
        self.thread.start()
        self.url = f"http://localhost:{started.result()}{where}"
        return self

    def stop(self) -> None:
        """Serve no longer."""
        self.loop.add_callback(self.loop.stop)
        self.thread.join()

    def _repr_html_(self) -> str:
        url = self.url or self.serve().url
        return f'<iframe src="{url}" style="width: 100%; height: 900px; border: 0"></iframe>'

    def html(self, report: Callable[[int, int], None] = lambda *_: None) -> str:
        """One HTML text with the results at all places, which needs no server.

        Raises
        ------
        InputError
            There are too many places, or the text is too long.
        """
        from bokeh.document import Document
        from bokeh.embed import file_html
        from bokeh.models import CustomJS
        from bokeh.resources import INLINE

        lengths = [len(slider.values) for slider in self.sliders]
        count = math.prod(lengths)
        remedy = "choose fewer sliders with --slide"
        if count > MOST_STATES:
            raise InputError.of("slide", count, "results are too many", remedy)
        self.check()
        states = []
        for number, places in enumerate(itertools.product(*map(range, lengths))):
            report(number, count)
            states.append(self.state(places))
        report(count, count)
        document = Document()
        view = self.fill(document, self.state(self.starts))
        view["measured"].visible = False
        for slider in view["sliders"]:
            arguments = {"view": view, "states": states}
            slider.js_on_change("value", CustomJS(args=arguments, code=_STATES))
        text = file_html(document, INLINE, template=_TEMPLATE)
        if len(text) > MOST_BYTES:
            size = f"{len(text) / 1e6:.1f} MB"
            raise InputError.of("slide", size, "is above 5 MB", remedy)
        return text


def _map(source: Any, title: str) -> Any:
    """The plot of a map of pressure, in the colours of print."""
    from bokeh import models as widgets
    from bokeh.plotting import figure

    colours = figures.pressure_colours()
    plot: Any = figure(
        title=title,
        x_axis_label="x (nm)",
        y_axis_label="y (nm)",
        match_aspect=True,
        height=300,
        sizing_mode=_WIDE,
    )
    mapper = widgets.LinearColorMapper(
        palette=[to_hex(colours(level)) for level in range(256)],
        nan_color="white",
    )
    extent: Any = {"x": 0, "y": 0, "dw": "width", "dh": "height"}
    plot.image("image", source=source, **extent, color_mapper=mapper)
    plot.add_layout(widgets.ColorBar(color_mapper=mapper), "right")
    return plot


def _compute(moves: Any, tell: Callable[[Sequence[int], bool], None]) -> None:
    """Tell the result at the last move quickly, and all of it when nothing moves; until the page is closed."""
    places, quick = moves.get(), False
    while places is not None:
        if quick and not moves.empty():
            places = moves.get()
            continue
        tell(places, quick)
        try:
            places = moves.get(timeout=REST if quick else None)
            quick = True
        except queue.Empty:
            quick = False
