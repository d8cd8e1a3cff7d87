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


def unwrapped(bundle: str) -> str:
    """Return a bundle of plotly without the function for module loaders that is around it; as it is if it has none.

    A browser reads through a function that is handed to another one, and compiles it once more when it is called: a
    third of the time in which a report opens, for 4.8 MB.
    """
    comment, wrapped, rest = bundle.partition("(\n function(root, factory) {")
    inside, ended, after = rest.partition("this, () => {\n")[2].rpartition("\nreturn Plotly;\n}));")
    return f"{comment}{inside}" if wrapped and ended and not after.strip() else bundle


@cache
def _bundle() -> str:
    """Return plotly's whole bundle, compressed and as text: of 4.8 MB 2 are left, which each browser unpacks."""
    from plotly.offline import get_plotlyjs  # noqa: PLC0415  (a quarter of a second, which only a report spends)

    # Without a time inside, so that the same study gives the same page.
    return base64.b64encode(gzip.compress(unwrapped(get_plotlyjs()).encode(), mtime=0)).decode()


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
