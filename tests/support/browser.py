"""Pages in a browser: Debian's chromium, driven by Playwright."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest


@contextmanager
def chromium() -> Iterator[Any]:
    """The browser. Skips the test where it or Playwright is missing."""
    reason = "is not installed: the page is in no browser"
    playwright = pytest.importorskip("playwright.sync_api", reason=f"Playwright {reason}")
    if (path := shutil.which("chromium")) is None:
        pytest.skip(f"chromium {reason}")
    arguments = ["--no-sandbox"] if os.geteuid() == 0 else []
    with playwright.sync_playwright() as started:
        launched = started.chromium.launch(executable_path=path, args=arguments)
        yield launched
        launched.close()


def opened(browser: Any, file: Path, width: int = 1280, scheme: str = "light", **context: Any) -> Any:
    """The page, open; `errors` and `requests` hold what it complained of and asked for. context: of Playwright."""
    page = browser.new_context(viewport={"width": width, "height": 900}, color_scheme=scheme, **context).new_page()
    page.errors, page.requests = [], []
    page.on("console", lambda said: page.errors.append(said.text) if said.type == "error" else None)
    page.on("pageerror", lambda error: page.errors.append(str(error)))
    page.on("request", lambda asked: page.requests.append(asked.url))
    page.goto(file.as_uri())
    return page


def texts_drawn(page: Any) -> Callable[[], list[str]]:
    """Return what tells which texts were written on any canvas since it was asked last."""
    page.evaluate(
        """() => {
          window.written = [];
          const write = CanvasRenderingContext2D.prototype.fillText;
          CanvasRenderingContext2D.prototype.fillText = function (text, ...rest) {
            window.written.push(text);
            write.call(this, text, ...rest);
          };
        }"""
    )
    return lambda: list(page.evaluate("() => window.written.splice(0)"))


def serious_faults(page: Any) -> list[tuple[str, str]]:
    """What axe finds serious or critical. Skips the test where axe is missing."""
    axe = pytest.importorskip("axe_playwright_python.sync_playwright", reason="axe is not installed")
    found = axe.Axe().run(page).response["violations"]
    return [
        (fault["id"], fault["nodes"][0]["html"][:200]) for fault in found if fault["impact"] in ("serious", "critical")
    ]
