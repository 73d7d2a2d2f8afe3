"""The site of the documentation, for Sphinx: ``scripts/docs`` builds it, with the pages of the ids."""

import dataclasses
import os
import re
import sys
import textwrap
from pathlib import Path
from typing import Any

from docutils import nodes
from sphinx import addnodes
from sphinx.application import Sphinx

from pacman_env import __version__

project = "pacman_env"
author = "the pacman_env developers"
project_copyright = author
release = version = __version__

extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx.ext.viewcode", "sphinx_copybutton"]
exclude_patterns = ["examples"]
templates_path = ["_templates"]
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_js_files = ["site.js"]
html_baseurl = os.environ.get("READTHEDOCS_CANONICAL_URL", "")  # the address of the site, for links that are shared
html_theme = "celshast"
html_title = f"pacman_env {release}"
html_copy_source = False
html_show_sourcelink = False
html_favicon = "_static/pacman.svg"
html_theme_options = {
    "description": "A TurtleBot 4 plays Pac-Man in a house: a reproducible Gymnasium and PettingZoo environment.",
    "light_logo": "pacman.svg",
    "dark_logo": "pacman.svg",
}

nb_execution_mode = "off"  # pages show what the files keep
nb_output_stderr = "remove"
myst_heading_anchors = 4  # as GitHub makes them
myst_enable_extensions: list[str] = []  # the theme adds to it
suppress_warnings = ["myst.strikethrough"]

default_role = "code"  # docstrings have `names` as Markdown does
autodoc_mock_imports = ["stable_baselines3", "torch"]  # of the extra ``train``, which is 1 GB
autodoc_member_order = "bysource"
autodoc_default_options = {"members": True}
toc_object_entries_show_parents = "hide"
autodoc_typehints_format = "short"
napoleon_google_docstring = True
napoleon_numpy_docstring = False
pygments_style = "default"  # with this, and the other in the dark, contrasts are at least 4.5
pygments_dark_style = "github-dark"
copybutton_exclude = ".linenos, .gp, .go"

_ARRAY = re.compile(
    r"~?(?:numpy\.)?ndarray\[tuple\[(?:~?typing\.)?Any, \.\.\.\], ~?(?:numpy\.)?dtype\[~?(?:numpy\.|typing\.)?(\w+)\]\]"
)
_PAGE = re.compile(r"`+docs/((?:\w+/)*\w+)\.md`+")
_ATTRIBUTES: dict[str, list[str]] = {}
_BELOW = {"use_with/README": "*", "environments/ids": "ids/*"}
_FRONT = {"index": "firstpage", "replay": "hide-toc"}
_PREVIEW = "images/web-1440.png"  # what a shared link shows
_LONGEST = 160  # characters of a description; search engines show no more
_SENTENCES = re.compile(rf".{{1,{_LONGEST - 1}}}[.!?](?= |$)")
_GENERATED = {
    "genindex": "All documented names of pacman_env in alphabetical order.",
    "search": "Search the documentation of pacman_env.",
    "_modules/index": "The modules whose source code this site shows.",
}
_FENCE = re.compile(r"^( *)```(\w*)\n(.*?)^ *```$", re.MULTILINE | re.DOTALL)


def _restructured(app: Sphinx, what: str, name: str, obj: object, options: object, lines: list[str]) -> None:
    """Convert fenced code of a docstring to reStructuredText, which autodoc reads; the rest is the same in both."""

    def block(match: re.Match[str]) -> str:
        indent, language, code = match.groups()
        body = "".join(f"    {line}\n" if line.strip() else "\n" for line in code.splitlines())
        return f"{indent}.. code-block:: {language or 'text'}\n\n{body}"

    if "## Description" in lines:  # Markdown as Gymnasium's own docstrings, which the pages of the ids show
        start = lines.index("## Description") + 1
        lines[:] = [*lines[start : lines.index("", start)], "", "Its pages: :doc:`/environments/ids`."]
    text = _PAGE.sub(r":doc:`/\1`", "\n".join(lines))
    lines[:] = _FENCE.sub(block, text).splitlines()
    for k in range(len(lines) - 1, 0, -1):  # a list needs an empty line before it
        if lines[k].startswith("- ") and lines[k - 1].strip() and not lines[k - 1].startswith(("- ", " ")):
            lines.insert(k, "")
    if what in ("attribute", "property"):
        _ATTRIBUTES[name] = list(lines)


def _restored(app: Sphinx, what: str, name: str, obj: object, options: object, lines: list[str]) -> None:
    """Restore the docstring of an attribute: Napoleon takes the words before its first colon for a type."""
    lines[:] = _ATTRIBUTES.pop(name, lines)


def _shorter(
    app: Sphinx, what: str, name: str, obj: object, options: object, arguments: str | None, result: str | None
) -> tuple[str | None, str | None]:
    """Return a signature with ``NDArray`` as in the source; for a dataclass only the names of its fields."""
    if what == "class" and dataclasses.is_dataclass(obj):
        arguments = f"({', '.join(field.name for field in dataclasses.fields(obj))})"
    elif getattr(obj, "_is_protocol", False):
        arguments = None  # of no use to who implements it
    short = (text and _ARRAY.sub(r"NDArray[\1]", text) for text in (arguments, result))
    return next(short), next(short)


def _adapted(app: Sphinx, page: str, source: list[str]) -> None:
    """Add what only the site has: marks in the front matter, and pages below a page."""
    if page in _FRONT:  # which GitHub would show as a table
        source[0] = f"---\n{_FRONT[page]}: true\n---\n{source[0]}"
    if page in _BELOW:
        source[0] += f"\n```{{toctree}}\n:hidden:\n:glob:\n\n{_BELOW[page]}\n```\n"


def _themed(app: Sphinx, doctree: nodes.document) -> None:
    """Show a dark picture in the dark theme if there is one: ``NAME-dark.png`` of ``NAME.png``."""
    for light in [*doctree.findall(nodes.image)]:
        path = Path(light["uri"])
        dark = light.deepcopy()
        dark["uri"] = path.with_stem(f"{path.stem}-dark").as_posix()
        if (Path(app.env.doc2path(app.env.docname)).parent / dark["uri"]).is_file():
            for image, theme in ((light, "light"), (dark, "dark")):
                image["classes"].append(f"only-{theme}")
                image["loading"] = "lazy"  # the hidden one is not fetched
            light.parent.insert(light.parent.index(light) + 1, dark)


def _scripted(app: Sphinx, page: str, template: str, context: dict[str, object], doctree: object) -> None:
    """Load the scripts of the replay on its page only."""
    for name in ("replay_page", "replay_rounds", "replay") if page == "replay" else ():
        app.add_js_file(f"{name}.js", loading_method="defer")


def _first_paragraph(doctree: nodes.document) -> str:
    """Return the first paragraph of a page that is in no list, table or note, and has words."""
    for paragraph in doctree.findall(nodes.paragraph):
        text = "".join(node.astext() for node in paragraph.findall(nodes.Text))  # without the words for a picture
        if text.strip() and isinstance(paragraph.parent, (nodes.document, nodes.section, addnodes.desc_content)):
            return text
    return ""


def _described(app: Sphinx, page: str, template: str, context: dict[str, Any], doctree: nodes.document | None) -> None:
    """Set the description of a page and the address of the picture that a shared link shows, for ``page.html``."""
    source = getattr(sys.modules.get(context.get("title", "")), "__doc__", None) or ""  # of a page of viewcode
    words = _first_paragraph(doctree) if doctree else source.partition("\n\n")[0].replace("``", "")
    text = " ".join((words or _GENERATED.get(page, html_theme_options["description"])).split())
    sentences = _SENTENCES.match(text)
    context["description"] = sentences[0] if sentences else textwrap.shorten(text, _LONGEST, placeholder="…")
    picture = f"_images/{app.env.images[_PREVIEW][1]}"
    base = app.config.html_baseurl
    context["preview"] = f"{base.rstrip('/')}/{picture}" if base else context["pathto"](picture, 1)


def setup(app: Sphinx) -> None:
    """Connect what reads pages, docstrings and signatures."""
    app.connect("source-read", _adapted)
    app.connect("doctree-read", _themed, priority=400)  # before pictures are collected
    app.connect("html-page-context", _scripted)
    app.connect("html-page-context", _described)
    app.connect("autodoc-process-docstring", _restructured, priority=400)  # before Napoleon
    app.connect("autodoc-process-docstring", _restored, priority=600)
    app.connect("autodoc-process-signature", _shorter)
