"""A headless Chromium for the tests of pages: opened once, asked by JavaScript, with what it logged and requested."""

from __future__ import annotations

import base64
import json
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import cv2
import numpy as np

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
"""Programs by name, the first that is installed."""
SIZE = (1200, 800)
"""Of the window [px]."""
_SECONDS = 120
"""Most that a page may take: pictures are drawn by the processor."""


def browser_path() -> str | None:
    """The installed Chromium; None where there is none. PHOTOCLINOMETRY_BROWSER names another one."""
    named = os.environ.get("PHOTOCLINOMETRY_BROWSER")
    return named or next((found for found in map(shutil.which, BROWSERS) if found), None)


def why_no_browser() -> str | None:
    """Why pages cannot be tested; None where they can.

    Raises RuntimeError in place of a reason where PHOTOCLINOMETRY_NEEDS_BROWSER is set, so that nothing is skipped.
    """
    reason = None
    if find_spec("selenium") is None:
        reason = "selenium is not installed"
    elif browser_path() is None:
        reason = f"none of {', '.join(BROWSERS)} is installed"
    elif shutil.which("chromedriver") is None:
        reason = "chromedriver is not installed"
    if reason and os.environ.get("PHOTOCLINOMETRY_NEEDS_BROWSER"):
        raise RuntimeError(f"tests of pages in a browser cannot run: {reason}")
    return reason


class Page:
    """The page that the browser shows."""

    def __init__(self, driver: Any):
        self.driver = driver

    def open(self, path: Path, fragment: str = "") -> None:
        """Opens a viewer's page, and waits until its map is drawn. Forgets what was logged before."""
        self.driver.get("about:blank")
        self.messages()
        self.driver.get(path.as_uri() + fragment)
        self.wait("window.viewer !== undefined || document.getElementById('message').textContent.includes('cannot')")

    def run(self, script: str, *arguments: Any) -> Any:
        """What a function body returns: `return ...`. The page's viewer is `viewer`."""
        return self.driver.execute_script(script, *arguments)

    def wait(self, condition: str) -> None:
        """Until an expression is true."""
        from selenium.webdriver.support.ui import WebDriverWait

        WebDriverWait(self.driver, _SECONDS, 0.02).until(lambda driver: driver.execute_script(f"return {condition}"))

    def settle(self) -> None:
        """Until all that was changed is drawn, and images are decoded."""
        self.driver.execute_async_script(
            "const done = arguments[0]; setTimeout(() => requestAnimationFrame(() => done()), 60)"
        )
        self.wait("viewer.waiting === null || viewer.waiting === undefined")

    def set(self, control: str, value: Any) -> None:
        """Gives a control by its id a value, as a person would: a check box is ticked by True."""
        self.run(
            "const [id, value] = arguments, e = document.getElementById(id);"
            "if (e.type === 'checkbox') e.checked = value; else e.value = value;"
            "e.dispatchEvent(new Event('input', { bubbles: true }))",
            control,
            value,
        )
        self.settle()

    def click(self, selector: str) -> None:
        """Clicks the first element that a CSS selector finds."""
        self.driver.find_element("css selector", selector).click()
        self.settle()

    def press(self, *keys: str) -> None:
        """Types on the map."""
        overlay = self.driver.find_element("id", "overlay")
        for key in keys:
            overlay.send_keys(key)
        self.settle()

    def drag(self, *places: tuple[float, float], button: str = "left", alt: bool = False) -> None:
        """Presses a mouse button at the first place [px of the window], moves over the others, and lets go."""
        held = {"button": button, "buttons": {"left": 1, "right": 2}[button], "modifiers": int(alt), "clickCount": 1}
        kinds = ["mousePressed", *["mouseMoved"] * (len(places) - 1), "mouseReleased"]
        for kind, (x, y) in zip(kinds, [*places, places[-1]], strict=True):
            self.driver.execute_cdp_cmd("Input.dispatchMouseEvent", {"type": kind, "x": x, "y": y, **held})
        self.settle()

    def hover(self, x: float, y: float) -> None:
        """Moves the mouse to a place."""
        self.driver.execute_cdp_cmd("Input.dispatchMouseEvent", {"type": "mouseMoved", "x": x, "y": y})
        self.settle()

    def wheel(self, x: float, y: float, down: float) -> None:
        """Turns the mouse's wheel at a place."""
        event = {"type": "mouseWheel", "x": x, "y": y, "deltaX": 0, "deltaY": down}
        self.driver.execute_cdp_cmd("Input.dispatchMouseEvent", event)
        self.settle()

    def touch(self, *moments: list[tuple[float, float]]) -> None:
        """Fingers on the screen: their places at one moment after the other."""
        for kind, fingers in zip(["touchStart", *["touchMove"] * (len(moments) - 1)], moments, strict=True):
            points = [{"x": x, "y": y, "id": i} for i, (x, y) in enumerate(fingers)]
            self.driver.execute_cdp_cmd("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})
        self.driver.execute_cdp_cmd("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
        self.settle()

    def picture(self, canvas: str = "picture") -> np.ndarray:
        """A canvas (h, w, 3) uint8: "picture" is the map, "overlay" what is drawn above it."""
        text = self.run("viewer.draw(); return viewer[arguments[0]].toDataURL('image/png')", canvas)
        data = np.frombuffer(base64.b64decode(text.split(",")[1]), np.uint8)
        return cv2.cvtColor(cv2.imdecode(data, cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB)

    def state(self, name: str) -> Any:
        """A part of the viewer's state."""
        return self.run("return viewer.store.state[arguments[0]]", name)

    def messages(self) -> list[str]:
        """Errors and warnings of the page since the last call; but for those of its pictures' way to the window."""
        logged = [f"{entry['level']}: {entry['message']}" for entry in self.driver.get_log("browser")]
        return [message for message in logged if "GPU stall due to ReadPixels" not in message]

    def requests(self) -> list[str]:
        """Addresses that the page asked for since the last call."""
        events = [json.loads(entry["message"])["message"] for entry in self.driver.get_log("performance")]
        return [e["params"]["request"]["url"] for e in events if e["method"] == "Network.requestWillBeSent"]

    def save(self, path: Path | str) -> None:
        """The window as a PNG file."""
        self.driver.save_screenshot(str(path))


@contextmanager
def browser(folder: Path, size: tuple[int, int] = SIZE) -> Iterator[Page]:
    """A Chromium whose downloads go to `folder`; it draws by the processor, so that pictures are the same anywhere."""
    from selenium import webdriver

    options = webdriver.ChromeOptions()
    options.binary_location = browser_path() or ""
    for flag in ("headless=new", "no-sandbox", "use-angle=swiftshader", "enable-unsafe-swiftshader", "mute-audio"):
        options.add_argument(f"--{flag}")
    for flag in ("gpu-compositing", "gpu-rasterization", "accelerated-2d-canvas"):
        options.add_argument(f"--disable-{flag}")  # all but WebGL: an emulated GPU takes half as long again for them
    options.add_argument(f"--window-size={size[0]},{size[1]}")
    options.add_argument("--force-device-scale-factor=1")
    options.add_experimental_option("prefs", {"download.default_directory": str(folder)})
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    driver = webdriver.Chrome(options, webdriver.ChromeService(executable_path=shutil.which("chromedriver")))
    driver.set_script_timeout(_SECONDS)
    try:
        yield Page(driver)
    finally:
        driver.quit()
