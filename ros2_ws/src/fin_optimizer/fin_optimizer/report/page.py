"""The HTML file: a template filled in, with style, script and plotly's own bundle inside: nothing is fetched."""

from __future__ import annotations

import base64
import gzip
from functools import cache
from importlib import resources
from typing import TYPE_CHECKING

from jinja2 import Environment, PackageLoader, StrictUndefined

if TYPE_CHECKING:
    from fin_optimizer.report.parts import Page

_TEMPLATE, _STYLE, _SCRIPT = "page.html.jinja", "page.css", "page.js"


@cache
def _bundle() -> str:
    """Return plotly's whole bundle, compressed and as text: of 4.8 MB 2 are left, which each browser unpacks."""
    from plotly.offline import get_plotlyjs  # noqa: PLC0415  (a quarter of a second, which only a report spends)

    # Without a time inside, so that the same study gives the same page.
    return base64.b64encode(gzip.compress(get_plotlyjs().encode(), mtime=0)).decode()


def _own(name: str) -> str:
    return (resources.files("fin_optimizer.report") / name).read_text(encoding="utf-8")


def html_of(page: Page) -> str:
    """Return a page as the text of one file; what stands in it is escaped by the template."""
    environment = Environment(
        loader=PackageLoader("fin_optimizer", "report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    with_plots = any(block.kind == "plot" for section in page.sections for block in section.blocks)
    return environment.get_template(_TEMPLATE).render(
        page=page, style=_own(_STYLE), script=_own(_SCRIPT), bundle=_bundle() if with_plots else ""
    )
