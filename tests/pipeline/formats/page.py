"""An HTML page, parsed by the standard library."""

from __future__ import annotations

from dataclasses import dataclass, field
from html.parser import HTMLParser

# Elements without an end tag.
_VOID = {"meta", "link", "br", "img", "input", "hr", "source"}


@dataclass
class Element:
    """An element with its attributes and all text inside it."""

    tag: str
    attributes: dict[str, str]
    text: str = ""
    children: list[Element] = field(default_factory=list)

    def all(self, tag: str) -> list[Element]:
        """Elements with a tag inside this one, in the page's order."""
        found = [child for child in self.children if child.tag == tag]
        return [
            element
            for child in self.children
            for element in ([child] if child in found else []) + child.all(tag)
        ]

    @property
    def flat_text(self) -> str:
        """The text with runs of white space replaced by single spaces."""
        return " ".join(self.text.split())


class Page(HTMLParser):
    """Parses a page; `root` contains all elements, `unbalanced` the tags without a partner."""

    def __init__(self, html: str) -> None:
        super().__init__(convert_charrefs=True)
        self.html = html
        self.root = Element("", {})
        self.elements: list[Element] = []
        self.unbalanced: list[str] = []
        self._open = [self.root]
        self.feed(html)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        element = Element(tag, {name: value or "" for name, value in attrs})
        self._open[-1].children.append(element)
        self.elements.append(element)
        if tag not in _VOID:
            self._open.append(element)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        element = Element(tag, {name: value or "" for name, value in attrs})
        self._open[-1].children.append(element)
        self.elements.append(element)

    def handle_endtag(self, tag: str) -> None:
        if self._open[-1].tag == tag:
            self._open.pop()
        else:
            self.unbalanced.append(tag)

    def handle_data(self, data: str) -> None:
        for element in self._open:
            element.text += data

    def all(self, tag: str) -> list[Element]:
        """All elements with a tag."""
        return [element for element in self.elements if element.tag == tag]

    def with_class(self, name: str) -> list[Element]:
        """All elements with a class."""
        return [e for e in self.elements if name in e.attributes.get("class", "").split()]
