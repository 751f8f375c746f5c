"""The page of a report: its parts, and the template that turns it into one HTML file that needs no network.

The only file that knows jinja2. Figures are embedded as SVG in data URIs, in a wide and a narrow layout of which the
browser takes the one that fits; the style stands in the page's head.
"""

from base64 import b64encode
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple

from jinja2 import Environment, PackageLoader, StrictUndefined

from swarm.report.figures import NARROW_BELOW_PX, Picture
from swarm.report.numbers import number


class Column(NamedTuple):
    """Head of a table's column, and the unit below it."""

    name: str
    unit: str = ""


@dataclass(frozen=True)
class Table:
    """A table of texts. left: how many columns, from the left, are words rather than numbers."""

    columns: Sequence[Column]
    rows: Sequence[Sequence[str]]
    caption: str = ""
    left: int = 1


class Fact(NamedTuple):
    """A card: a figure that the reader should take away, with its unit and what it means.

    kind: "pass", "fail", or "" for what is neither. badge: a word in the card's corner.
    """

    name: str
    value: str
    meaning: str = ""
    kind: str = ""
    badge: str = ""


@dataclass(frozen=True)
class Section:
    """A part of the page: paragraphs, then figures, then tables."""

    title: str
    paragraphs: Sequence[str] = ()
    pictures: Sequence[Picture] = ()
    tables: Sequence[Table] = ()


@dataclass(frozen=True)
class Page:
    """A report.

    warning: what the reader must know first. verdict: the result in a line, and its kind, as a card's. commands,
    versions: how to get the same numbers again.
    """

    title: str
    subtitle: str
    sections: Sequence[Section]
    facts: Sequence[Fact] = ()
    warning: str = ""
    verdict: str = ""
    verdict_kind: str = ""
    commands: Sequence[str] = ()
    versions: Sequence[str] = ()
    reproduce: str = ""
    source_name: str = ""
    source: str = ""

    @property
    def pictures(self) -> list[Picture]:
        """The pictures of all sections."""
        return [picture for section in self.sections for picture in section.pictures]


def html(page: Page) -> str:
    """Return the whole page as HTML."""
    template = _environment(autoescape=True).get_template("report.html.j2")
    return template.render(page=page, narrow_px=NARROW_BELOW_PX)


def prose(template: str, block: str, **values: Any) -> list[str]:
    """Return the paragraphs of one block of a template of plain text.

    Args:
        template: File name of the template.
        block: Name of the block.
        **values: Values that the block fills in, by name.
    """
    found = _environment(autoescape=False).get_template(template)
    text = "".join(found.blocks[block](found.new_context(values)))
    return [" ".join(paragraph.split()) for paragraph in text.split("\n\n") if paragraph.strip()]


@cache
def _environment(autoescape: bool) -> Environment:
    environment = Environment(
        loader=PackageLoader("swarm.report"),
        autoescape=autoescape,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"data_uri": _data_uri, "number": number, "percent": percent, "count": count}
    return environment


def percent(value: float) -> str:
    """Return the text of a share that is in percent already."""
    return "< 0.001 %" if abs(value) < 0.001 else f"{number(value, 2)} %"


def count(value: float) -> str:
    """Return the text of a whole number, thousands apart."""
    return f"{value:,.0f}".replace(",", "\u202f")


def plain(value: object, digits: int = 6) -> str:
    """Return the text of a setting or an exact figure: a number without padded zeros, anything else as it is.

    Args:
        value: The value.
        digits: Most significant digits.
    """
    return f"{value:.{digits}g}" if isinstance(value, float) else str(value)


def _data_uri(svg: bytes) -> str:
    return f"data:image/svg+xml;base64,{b64encode(svg).decode('ascii')}"
