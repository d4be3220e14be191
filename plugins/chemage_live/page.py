"""The page: curves, map, table, sliders; on a server of this machine, in a notebook, or in one file."""

from __future__ import annotations

import asyncio
import itertools
import json
import math
import re
import secrets
import shlex
import socket
import tempfile
import threading
import time
from collections.abc import Mapping, Sequence
from html import escape
from importlib import resources
from pathlib import Path
from typing import Any, Literal, Self

import tomli_w
from matplotlib.colors import to_hex
from pydantic import Base64Bytes, BaseModel, TypeAdapter, ValidationError

from chemage import ChemageError, InputError, errors, read_measurements
from chemage.plugin import (
    drawing,
    figures,
    options,
    output,
    override,
    progress,
    scene_data,
    statistics,
    text,
    write_file,
)
from chemage_live.model import LiveScene, table, with_ends
from chemage_live.sliders import sliders_of

#: results and bytes of a file, at most
MOST_STATES, MOST_BYTES = 400, 5_000_000
#: on a server, and in a file: values of a slider, and pixels along a side of a map
ON_SERVER, IN_FILE = (41, 128), (5, 24)
HOST = "127.0.0.1"
#: of the source of measured points; no scene has a name with a slash
MEASURED = "measured/points"
_WIDE = "stretch_width"


class _Places(BaseModel, extra="forbid", strict=True):
    """What a browser sends of its sliders."""

    places: list[int]
    step: Literal["moving", "resting", "pictures"]


class _Table(BaseModel, extra="forbid", strict=True):
    """What it sends of a file; the content is in base 64."""

    name: str
    content: Base64Bytes


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
    ChemageError
        An option is no number of the scene; as of any run of the scene; or it ages nothing.
    MissingError
        bokeh is not installed: ``pip install 'chemage[live]'``.
    """

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
        self.changes = dict(changes or {})
        base = override(data, {"sweep": None, **self.changes})
        self.scenes = [LiveScene(base)]
        self.sliders = sliders_of(self.scenes[0].own, slide, count)
        if beside is not None:
            other = override(scene_data(beside)[0], {"sweep": None})
            if other["name"] == base["name"]:
                other["name"] += " beside"
            self.scenes.append(LiveScene(other))
        self.equal_pressure = equal_pressure
        self.lessened = "For a quick answer" if in_file else "While you move"
        #: where it is served
        self.url = ""
        # so that what is wrong with the scenes' own values is said here and not in a browser
        self._compute({}, quick=True)

    def _compute(self, moved: Mapping[str, Any], quick: bool) -> str:
        """Compute the scenes, the second at the load, or the mean pressure, of the first; what is less, in words."""
        changes, less = dict(moved), ""
        for scene in self.scenes:
            less = scene.at(changes, quick) or less
            contact = scene.last.contact
            changes["contact.load"] = f"{contact.load} nN"
            if self.equal_pressure:
                pressure = contact.mean_contact_pressure
                changes["contact.load"] = f"{pressure} GPa over contact"
        return less

    def command(self, moved: Mapping[str, Any]) -> str:
        """The command that repeats what is shown."""
        command = ["chemage", "run", self.where]
        for path, value in {**self.changes, **moved}.items():
            plain = (
                isinstance(value, str)
                and options.changed_fields([f"x={value}"])["x"] == value
            )
            command += ["--set", f"{path}={value if plain else json.dumps(value)}"]
        return shlex.join(command)

    def state(self, places: Sequence[int], quick: bool = False) -> dict[str, Any]:
        """What is shown at these places: texts and columns, by the names of what shows them. Of an error of a scene there
        are its words alone."""
        moved = {
            slider.path: slider.values[place]
            for slider, place in zip(self.sliders, places, strict=True)
        }
        try:
            less = self._compute(moved, quick)
        except ChemageError as error:
            return {"words": escape(str(error))}
        state: dict[str, Any] = {
            "words": less and f"{self.lessened}: {less}.",
            "table": table([scene.last for scene in self.scenes]),
            "command": escape(self.command(moved)),
            "toml": escape(tomli_w.dumps(override(self.scenes[0].data, moved))),
            "columns": {},
        }
        for scene in self.scenes:
            state["columns"] |= scene.sources(self.map_pixels)
        return state

    def answer(self, places: Sequence[int], step: str) -> dict[str, Any]:
        """What a browser asks for at a ``step``: the state with less while sliders are ``"moving"``, all of it where they
        are ``"resting"``, and with ``"pictures"``, as they are printed.

        Raises
        ------
        InputError
            There is no such place.
        """
        lengths = [len(slider.values) for slider in self.sliders]
        if len(places) != len(lengths) or not all(
            0 <= place < length
            for place, length in zip(places, lengths, strict=True)
        ):
            problem = f"the sliders have {lengths} values"
            raise InputError.of("places", places, problem)
        state = self.state(places, quick=step == "moving")
        if step == "pictures":
            drawn = drawing.figures(self.scenes[0].last).items()
            pictures = (figures.png(one, name) for name, one in drawn)
            state["pictures"] = "".join(pictures)
        return state

    def measured(self, name: str, content: bytes) -> dict[str, Any]:
        """The columns of the points in a table with this ``content``, or what is wrong with it in words."""
        try:
            with tempfile.TemporaryDirectory() as folder:
                ending = re.sub(r"[^\w.]", "", Path(name).suffix)[:9]
                file = Path(folder) / f"measured{ending}"
                write_file(file, content)
                read = read_measurements(file)
            quantity: Any = self.scenes[0].curve.name
            # at the load of the measurement: that of the slider moves
            found = read.as_quantity(quantity, None)
            if found is None:
                problem = f"is not {quantity}; give the load of the measurement"
                raise InputError.of("quantity", read.quantity, problem)
        except ChemageError as error:
            return {"words": escape(f"{name}: {error}")}
        error = 0.0 if found.error is None else found.error
        half = statistics.NORMAL_LIMIT * error
        points = with_ends(found.hold_times, found.values, half)
        return {"words": "", "columns": {MEASURED: points}}

    def serve(self, port: int = 0) -> Self:
        """Serve it from now on, to this machine alone, at the secret address ``url``.

        Raises
        ------
        InputError
            The port is taken.
        """
        from tornado.httpserver import HTTPServer
        from tornado.web import Application, RequestHandler

        page = self

        class Handler(RequestHandler):
            def get(self) -> None:
                self.write(page._html())

            def post(self) -> None:
                try:
                    asked = TypeAdapter(_Places | _Table).validate_json(
                        self.request.body
                    )
                    answer = (
                        page.answer if isinstance(asked, _Places) else page.measured
                    )
                    said = answer(**dict(asked))
                except (ValidationError, InputError) as error:
                    self.set_status(400)
                    said = {"words": escape(str(error))}
                self.write(text.jsonable(said))

        try:
            listening = socket.create_server((HOST, port))
        except OSError as error:
            problem = f"is not free ({error.strerror})"
            remedy = "choose another, or 0 for any"
            raise InputError.of("port", port, problem, remedy) from None
        where = f"/{secrets.token_urlsafe(16)}"
        listening.setblocking(False)
        self.server = HTTPServer(Application([(where, Handler)]))
        self.loop = asyncio.new_event_loop()
        self.loop.call_soon(self.server.add_socket, listening)
        self.thread = threading.Thread(target=self.loop.run_forever, daemon=True)
        self.thread.start()
        self.url = f"http://localhost:{listening.getsockname()[1]}{where}"
        return self

    def stop(self) -> None:
        """Serve no longer."""
        self.loop.call_soon_threadsafe(self.server.stop)
        self.loop.call_soon_threadsafe(self.loop.stop)
        self.thread.join()

    def _repr_html_(self) -> str:
        url = self.url or self.serve().url
        return f'<iframe src="{url}" style="width: 100%; height: 900px; border: 0"></iframe>'

    def html(self, full: bool = False) -> str:
        """One HTML text with the results at all places, which needs no server; in ``full``, or else with less, as while
        sliders move. What it costs is said first.

        Raises
        ------
        InputError
            There are too many places, or the text is too long.
        """
        lengths = [len(slider.values) for slider in self.sliders]
        count = math.prod(lengths)
        remedy = "choose fewer sliders with --slide"
        if count > MOST_STATES:
            raise InputError.of("slide", count, "results are too many", remedy)
        ends = [0] * len(lengths), [length - 1 for length in lengths]
        begin = time.perf_counter()
        for places in ends:
            self.state(places, quick=not full)
        seconds = 0.5 * count * (time.perf_counter() - begin)
        less = "" if full else "; --full: with all pixels and replicas"
        output.remark(f"{count} results: about {math.ceil(seconds)} s{less}")
        states = []
        with progress.progress_bars({"computing": "results"}) as report:
            for places in itertools.product(*map(range, lengths)):
                states.append(self.state(places, quick=not full))
                report("computing", len(states), count)
        page = self._html(states)
        if len(page) > MOST_BYTES:
            size = f"{len(page) / 1e6:.1f} MB"
            raise InputError.of("slide", size, "is above 5 MB", remedy)
        return page

    def _html(self, states: Sequence[Mapping[str, Any]] = ()) -> str:
        """The page with the ``states`` at all places; without any, it asks the server for them."""
        from bokeh.embed import file_html
        from bokeh.layouts import column
        from bokeh.models import ColumnDataSource
        from bokeh.plotting import figure
        from bokeh.resources import INLINE

        curve = self.scenes[0].curve
        plot: Any = figure(
            x_axis_type="log",
            x_axis_label=curve.axis_of.axis,
            y_axis_label=curve.axis,
            height=340,
            sizing_mode=_WIDE,
        )
        plots = [plot]
        for scene, colour in zip(self.scenes, figures.PALETTE, strict=False):
            for name, columns in scene.sources(self.map_pixels).items():
                source = ColumnDataSource(columns, name=name)
                if "image" in columns:
                    plots.append(_map(source, name.replace("/", ": ")))
                    continue
                of = {"source": source, "color": colour, "legend_label": name}
                plot.varea("x", "low", "high", alpha=0.2, **of)
                plot.line("x", "y", width=2, **of)
        nothing: Any = dict.fromkeys(("x", "y", "low", "high"), ())
        points = ColumnDataSource(nothing, name=MEASURED)
        plot.segment("x", "low", "x", "high", source=points, color="black")
        plot.scatter("x", "y", source=points, color="black", size=5)
        plot.legend.location = "top_left"
        template = (
            resources.files("chemage_live")
            .joinpath("page.html.j2")
            .read_text("utf-8")
        )
        return file_html(
            column(*plots, sizing_mode=_WIDE),
            INLINE,
            title=f"chemage live: {self.where}",
            template=template,
            template_variables={
                "sliders": self.sliders,
                "states": text.jsonable(states),
            },
        )


def _map(source: Any, title: str) -> Any:
    """The plot of a map of pressure, in the colours of print."""
    from bokeh.models import LinearColorMapper
    from bokeh.plotting import figure

    plot: Any = figure(
        title=title,
        x_axis_label="x (nm)",
        y_axis_label="y (nm)",
        match_aspect=True,
        height=300,
        sizing_mode=_WIDE,
    )
    palette = [*map(to_hex, figures.pressure_colours()(range(256)))]
    mapper = LinearColorMapper(palette=palette, nan_color="white")
    extent: Any = {"x": 0, "y": 0, "dw": "width", "dh": "height"}
    drawn = plot.image("image", source=source, **extent, color_mapper=mapper)
    plot.add_layout(drawn.construct_color_bar(), "right")
    return plot
