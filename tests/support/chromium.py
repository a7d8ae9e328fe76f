"""Headless Chromium, driven over its own protocol through a pipe: no driver and no package besides."""

from __future__ import annotations

import base64
import json
import os
import select
import shutil
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

NAMES = ("chromium", "chromium-browser", "google-chrome", "chrome")
_ARGUMENTS = (
    "--headless=new",
    "--no-sandbox",
    "--disable-gpu",
    "--enable-unsafe-swiftshader",  # 3-D views, drawn by the processor
    "--disable-dev-shm-usage",
    "--disable-background-networking",
    "--no-first-run",
    "--hide-scrollbars",
    "--remote-debugging-pipe",
)


def browser_program() -> str | None:
    """The program, or none where there is none."""
    return next((found for name in NAMES if (found := shutil.which(name))), None)


class Page:
    """A page of the browser."""

    def __init__(self, send: int, receive: int) -> None:
        self._send, self._receive = send, receive
        self._last, self._buffer, self._session = 0, b"", None
        self._events: list[dict[str, Any]] = []
        target = self._call("Target.createTarget", url="about:blank")["targetId"]
        self._session = self._call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self._call(f"{domain}.enable")

    def size(self, width: int, height: int) -> None:
        """Set the size of the window in px."""
        self._call(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=1,
            mobile=False,
        )

    def offline(self) -> None:
        """Cut the page off from every network."""
        cut = {"offline": True, "latency": 0, "downloadThroughput": -1, "uploadThroughput": -1}
        self._call("Network.emulateNetworkConditions", **cut)

    def open(self, address: str) -> None:
        """Go to an address; what was heard of earlier pages is forgotten."""
        self._events.clear()
        self._call("Page.navigate", url=address)

    def errors(self) -> list[str]:
        """Errors and warnings on the console, exceptions, and what could not be loaded, since the page was opened."""
        self.value("0")
        found = []
        for event in self._events:
            what, name = event["params"], event["method"]
            if name == "Runtime.exceptionThrown":
                found.append(json.dumps(what["exceptionDetails"]))
            elif name == "Runtime.consoleAPICalled" and what["type"] in ("error", "warning", "assert"):
                found.append(json.dumps(what["args"]))
            elif name == "Log.entryAdded" and what["entry"]["level"] == "error":
                found.append(json.dumps(what["entry"]))
            elif name == "Network.loadingFailed" and not what.get("canceled"):
                found.append(json.dumps(what))
        return found

    def requests(self) -> list[str]:
        """Addresses asked for since the page was opened, without data that the page itself holds."""
        self.value("0")
        asked = [
            e["params"]["request"]["url"] for e in self._events if e["method"] == "Network.requestWillBeSent"
        ]
        return [address for address in asked if not address.startswith(("data:", "blob:"))]

    def value(self, expression: str) -> Any:
        """What a JavaScript expression gives, as plain data."""
        answer = self._call(
            "Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True, userGesture=True
        )
        if "exceptionDetails" in answer:
            raise RuntimeError(f"{expression}: {answer['exceptionDetails']}")
        return answer["result"].get("value")

    def wait(self, expression: str, what: str, timeout_s: float = 30.0) -> Any:
        """The first value of an expression that is true."""
        deadline = time.monotonic() + timeout_s
        while not (found := self.value(expression)):
            if time.monotonic() > deadline:
                raise TimeoutError(
                    f"{what}: expected within {timeout_s:g} s, found a page that reads {self.text()[:2000]!r}"
                )
            time.sleep(0.1)
        return found

    def text(self) -> str:
        """All text that the page shows."""
        return str(self.value("document.body ? document.body.innerText : ''"))

    def wait_for_text(self, text: str, timeout_s: float = 30.0) -> None:
        """Wait until the page shows a text."""
        self.wait(f"document.body && document.body.innerText.includes({json.dumps(text)})", text, timeout_s)

    def click(self, x: float, y: float) -> None:
        """Press and release the mouse at a place in px."""
        self._call("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y)
        for kind in ("mousePressed", "mouseReleased"):
            self._call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=1)

    def click_element(self, expression: str, what: str) -> None:
        """Click in the middle of the element that an expression gives, once it is there."""
        place = self.wait(
            f"(() => {{ const e = {expression}; if (!e) return null; e.scrollIntoView({{block: 'nearest'}}); "
            "const r = e.getBoundingClientRect(); "
            "return r.width ? [r.x + r.width / 2, r.y + r.height / 2] : null; })()",
            what,
        )
        self.click(*place)

    def type(self, text: str) -> None:
        """Type into what has the focus."""
        self._call("Input.insertText", text=text)

    def press(self, key: str, code: int) -> None:
        """Press a key, by name and number."""
        for kind in ("keyDown", "keyUp"):
            more = {"text": "\r"} if key == "Enter" and kind == "keyDown" else {}
            self._call(
                "Input.dispatchKeyEvent", type=kind, key=key, code=key, windowsVirtualKeyCode=code, **more
            )

    def settle(self) -> None:
        """Wait until the page has drawn what it was asked for: some frames, and a moment besides."""
        self.value("new Promise(done => requestAnimationFrame(() => setTimeout(done, 400)))")

    def picture(self) -> bytes:
        """What the window shows as PNG."""
        return base64.b64decode(self._call("Page.captureScreenshot", format="png")["data"])

    def _call(self, method: str, **parameters: Any) -> dict[str, Any]:
        self._last += 1
        message: dict[str, Any] = {"id": self._last, "method": method, "params": parameters}
        if self._session is not None:
            message["sessionId"] = self._session
        os.write(self._send, json.dumps(message).encode() + b"\0")
        while True:
            answer = json.loads(self._message())
            if "method" in answer:
                self._events.append(answer)
            if answer.get("id") == self._last:
                if "error" in answer:
                    raise RuntimeError(f"{method}: {answer['error']}")
                return dict(answer["result"])

    def _message(self, timeout_s: float = 60.0) -> bytes:
        while b"\0" not in self._buffer:
            if not select.select([self._receive], [], [], timeout_s)[0]:
                raise TimeoutError(f"the browser did not answer within {timeout_s:g} s")
            part = os.read(self._receive, 1 << 20)
            if not part:
                raise RuntimeError("the browser has ended")
            self._buffer += part
        message, _, self._buffer = self._buffer.partition(b"\0")
        return message


@contextmanager
def chromium_page(profile: Path, width: int = 1500, height: int = 900) -> Iterator[Page]:
    """A page of a browser of its own, which is ended afterwards; ``profile`` is a folder that it may fill."""
    program = browser_program()
    if program is None:
        raise RuntimeError("expected chromium, found none")
    # The browser reads from its file 3 and writes to its file 4.
    to_browser, from_browser = os.pipe(), os.pipe()
    inner = f'exec "$0" "$@" 3<&{to_browser[0]} 4>&{from_browser[1]}'
    process = subprocess.Popen(
        ["bash", "-c", inner, program, *_ARGUMENTS, f"--user-data-dir={profile}"],
        pass_fds=(to_browser[0], from_browser[1]),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    os.close(to_browser[0])
    os.close(from_browser[1])
    try:
        page = Page(to_browser[1], from_browser[0])
        page.size(width, height)
        yield page
    finally:
        process.terminate()
        process.wait(timeout=20)
        os.close(to_browser[1])
        os.close(from_browser[0])
