"""Reads the HTML that classes show in notebooks, as a browser does."""

from __future__ import annotations

from html.parser import HTMLParser

HOSTILE = "<script>alert('x')</script>\"&amp; \ud800\x00<b"
"""A name with markup, quotes, an entity, half of a surrogate pair and a null character."""
SHOWN = "<script>alert('x')</script>\"&amp; \ufffd\ufffd<b"
"""The name as a reader sees it."""
_TAGS = {
    "div",
    "p",
    "table",
    "caption",
    "thead",
    "tbody",
    "tr",
    "th",
    "td",
    "svg",
    "path",
    "polyline",
    "circle",
    "text",
    "title",
}


class ShownHtml(HTMLParser):
    """Elements and texts of a piece of HTML.

    Attributes:
        elements: (tag, attributes) of each element.
        texts: The texts, in their order.
    """

    def __init__(self, html: str) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str]]] = []
        self.texts: list[str] = []
        self._open: list[str] = []
        html.encode()  # raises for half of a surrogate pair
        self.feed(html)
        self.close()
        assert not self._open
        assert {tag for tag, _ in self.elements} <= _TAGS
        for _, attributes in self.elements:  # nothing is loaded, and nothing is run
            assert not [name for name in attributes if name.startswith("on") or name in ("href", "src")]

    def handle_starttag(self, tag, attributes):
        self._open.append(tag)
        self.elements.append((tag, dict(attributes)))

    def handle_endtag(self, tag):
        assert self._open.pop() == tag

    def handle_data(self, data):
        self.texts.append(data)

    def all(self, tag: str) -> list[dict[str, str]]:
        """Attributes of the elements of a tag."""
        return [attributes for name, attributes in self.elements if name == tag.lower()]
