"""Chromium of the system, driven by Playwright."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager

import pytest


@contextmanager
def browser() -> Iterator[object]:
    """A browser, or skip where there is none."""
    playwright = pytest.importorskip("playwright.sync_api")
    path = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if path is None:
        pytest.skip("needs Chromium: apt-get install chromium")
    with playwright.sync_playwright() as running:
        started = running.chromium.launch(executable_path=path, args=["--no-sandbox", "--disable-gpu"])
        yield started
        started.close()


class Watch:
    """Collects errors of a page: messages of the console, exceptions, violations of the policy, other hosts."""

    def __init__(self, page, url: str) -> None:
        self.errors: list[str] = []
        page.on("console", self._note)
        page.on("pageerror", lambda error: self.errors.append(str(error)))
        page.on("request", lambda request: self._check(request.url, url))
        page.on("dialog", lambda dialog: (self.errors.append(f"dialog {dialog.message}"), dialog.dismiss()))

    def _note(self, message) -> None:
        if message.type == "error" and not message.text.startswith("Failed to load resource"):  # a status over 399
            self.errors.append(message.text)

    def _check(self, requested: str, url: str) -> None:
        if not requested.startswith((url, url.replace("http", "ws", 1), "data:", "blob:")):
            self.errors.append(f"requested {requested}")
