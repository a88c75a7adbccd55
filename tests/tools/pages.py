"""A page of HTML as its headings, tables and pictures."""

import base64
from html.parser import HTMLParser

VOID = {"meta", "img", "br", "link", "hr", "input"}


class Page(HTMLParser):
    """Reads a page; raises AssertionError where its tags do not close in order."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.text = text
        self.tables: dict[str, list[list[str]]] = {}
        self.pictures: list[bytes] = []
        self.ids: list[str] = []
        self._open: list[str] = []
        self._heading = ""
        self._cell: list[str] | None = None
        self.feed(text)
        self.close()
        assert self._open == []

    def handle_starttag(self, tag, attributes):
        values = dict(attributes)
        self.ids += [values["id"]] if "id" in values else []
        if tag == "img":
            kind, raw = values["src"].split(",", maxsplit=1)
            assert kind == "data:image/svg+xml;base64"
            assert values["alt"]
            self.pictures.append(base64.b64decode(raw))
        if tag in VOID:
            return
        self._open.append(tag)
        if tag in ("td", "th", "h2", "h3"):
            self._cell = []
        if tag == "tr":
            self.tables.setdefault(self._heading, []).append([])

    def handle_data(self, data):
        if self._cell is not None:
            self._cell.append(data)

    def handle_endtag(self, tag):
        assert self._open.pop() == tag
        if tag in ("td", "th"):
            self.tables[self._heading][-1].append("".join(self._cell).strip())
            self._cell = None
        if tag in ("h2", "h3"):
            self._heading = "".join(self._cell)
            self._cell = None

    def row(self, heading: str, first: str) -> list[str]:
        """The row that begins so in the tables below a heading."""
        (found,) = [row for row in self.tables[heading] if row and row[0] == first]
        return found


def number(cell: str) -> float:
    """A number as the report writes it."""
    return float(cell.replace(",", "").replace(" %", ""))
