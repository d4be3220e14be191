"""A real browser for the pages that chemage writes."""

from __future__ import annotations

import base64
import json
import os
import select
import shutil
import subprocess
import time
from itertools import count

import pytest

FLAGS = [
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--disable-dev-shm-usage",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]
# what chromium asks of a machine that may have no network, and pages that measure themselves
REPORT = """(() => {
  const wide = [...document.querySelectorAll('body *')].filter(e => !e.closest('.scroll') && !e.closest('svg')
      && e.getBoundingClientRect().right > innerWidth + 1).map(e => e.tagName + ' ' + e.textContent.slice(0, 40));
  const colour = s => getComputedStyle(document.body)[s];
  return {
    width: innerWidth, scrollWidth: document.documentElement.scrollWidth, wide,
    images: [...document.images].map(i => [i.complete, i.naturalWidth, i.alt]),
    drawings: [...document.querySelectorAll('svg')].map(s => [s.getBoundingClientRect().width,
      s.getBoundingClientRect().height, s.getAttribute('aria-label'), s.querySelectorAll('path').length]),
    drawn: [...document.querySelectorAll('svg path')].filter(p => p.getBoundingClientRect().width > 100).length,
    headings: [...document.querySelectorAll('h1, h2, h3')].map(h => [h.tagName, h.textContent]),
    text: document.body.innerText, ids: [...document.querySelectorAll('[id]')].map(e => e.id),
    colours: [colour('color'), colour('backgroundColor')],
    broken: [...document.querySelectorAll('use, a[href^="#"], [clip-path]')].map(e => e.getAttribute('href')
      || e.getAttribute('clip-path').slice(4, -1)).filter(h => !document.getElementById(h.slice(1))),
  };
})()"""


KEYS = {"ArrowRight": 39, "ArrowLeft": 37, "Tab": 9, "End": 35}


class Browser:
    """Chromium, spoken to through a pair of pipes (the DevTools protocol), so that nothing it does goes unseen."""

    def __init__(self, program, folder):
        to_browser, self._write = os.pipe()
        self._read, from_browser = os.pipe()
        words = [program, *FLAGS, f"--user-data-dir={folder}", "--remote-debugging-pipe", "about:blank"]
        self._errors = open(folder.with_suffix(".log"), "w+")  # noqa: SIM115
        self.process = subprocess.Popen(
            ["bash", "-c", f'exec "$@" 3<&{to_browser} 4>&{from_browser}', "bash", *words],
            pass_fds=(to_browser, from_browser),
            stdin=subprocess.DEVNULL,
            stdout=self._errors,
            stderr=self._errors,
        )
        os.close(to_browser)
        os.close(from_browser)
        self._number, self._buffer, self.events = count(1), b"", []
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Network", "Log", "Security"):
            self.call(f"{domain}.enable")

    def _message(self, deadline):
        while b"\0" not in self._buffer:
            ready, _, _ = select.select([self._read], [], [], max(0, deadline - time.monotonic()))
            chunk = os.read(self._read, 1 << 20) if ready else b""
            if not chunk:
                self._errors.seek(0)
                raise RuntimeError(f"chromium does not answer: {self._errors.read()[-2000:]}")
            self._buffer += chunk
        text, _, self._buffer = self._buffer.partition(b"\0")
        return json.loads(text)

    def call(self, method, **parameters):
        number, deadline = next(self._number), time.monotonic() + 300
        message = {"id": number, "method": method, "params": parameters}
        if session := getattr(self, "_session", None):
            message["sessionId"] = session
        os.write(self._write, json.dumps(message).encode() + b"\0")
        while (answer := self._message(deadline)).get("id") != number:
            self.events.append(answer)
        assert "error" not in answer, answer
        return answer["result"]

    def open(self, path, width, *, dark=False, media="screen", height=900):
        """Load a page at a window width, and tell what a reader would see and what went wrong."""
        phone = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 600}
        self.call("Emulation.setDeviceMetricsOverride", **phone)
        scheme = [{"name": "prefers-color-scheme", "value": "dark" if dark else "light"}]
        self.call("Emulation.setEmulatedMedia", media=media, features=scheme)
        self.events.clear()
        self.call("Page.navigate", url=path if isinstance(path, str) else path.as_uri())
        deadline = time.monotonic() + 300
        while not any(event.get("method") == "Page.loadEventFired" for event in self.events):
            self.events.append(self._message(deadline))
        seen = self.call("Runtime.evaluate", expression=REPORT, returnByValue=True)["result"]["value"]
        seen["requests"] = [e["params"]["request"]["url"] for e in self._events("Network.requestWillBeSent")]
        seen["complaints"] = [
            e["params"] for kind in ("Runtime.exceptionThrown", "Log.entryAdded", "Runtime.consoleAPICalled")
            for e in self._events(kind)
        ]  # fmt: skip
        return seen

    def _events(self, method):
        return [event for event in self.events if event.get("method") == method]

    def evaluate(self, expression):
        return self.call("Runtime.evaluate", expression=expression, returnByValue=True)["result"].get("value")

    def wait(self, expression):
        """Ask until the expression is true."""
        deadline = time.monotonic() + 300
        while not self.evaluate(expression):
            assert time.monotonic() < deadline, expression
            time.sleep(0.05)

    def press(self, key):
        for kind in ("rawKeyDown", "keyUp"):
            self.call("Input.dispatchKeyEvent", type=kind, key=key, code=key, windowsVirtualKeyCode=KEYS[key])

    def screenshot(self, path, *, whole=True):
        data = self.call("Page.captureScreenshot", format="png", captureBeyondViewport=whole)["data"]
        path.write_bytes(base64.b64decode(data))

    def pdf(self):
        return base64.b64decode(self.call("Page.printToPDF", printBackground=True)["data"])

    def close(self):
        self.process.terminate()
        try:
            self.process.wait(60)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        for pipe in (self._read, self._write):
            os.close(pipe)
        self._errors.close()


def chromium():
    """The browser's program: its absence is a failure, since a page nobody looked at is not checked."""
    found = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if found is None:
        told = "no chromium here; `apt-get install chromium` (the tests look at reports in a real browser)"
        if os.environ.get("CI"):
            pytest.fail(told)
        pytest.skip(told)
    return found


@pytest.fixture(scope="module")
def browser_words():
    """The command that opens a browser without a window."""
    return [chromium(), *FLAGS]


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    made = Browser(chromium(), tmp_path_factory.mktemp("browser") / "profile")
    yield made
    made.close()
