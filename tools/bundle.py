"""Join modules of the web page in one function for a classic script: browsers load no modules from the file system."""

import re

from tools.common import STATIC

_IMPORT = re.compile(r'^import (?:(\{[^}]*\}|\* as \w+) from )?"\./(\w+)\.js";\n', re.MULTILINE)
_EXPORT = re.compile(r"^export ((?:async )?(?:const|let|class|function) ([\w$]+))", re.MULTILINE)
_OTHER = re.compile(r"^(?:import|export)\b.*", re.MULTILINE)


def bundle(*names: str) -> str:
    """Return a JavaScript expression that runs modules, and those they import: the exports of each by its name.

    Raises:
        ValueError: a module contains an import or export of another form than the modules of the page.
    """
    modules: dict[str, str] = {}

    def add(name: str) -> None:
        if name in modules:
            return
        text = (STATIC / f"{name}.js").read_text(encoding="utf-8")
        for _, imported in _IMPORT.findall(text):
            add(imported)
        modules[name] = _module(name, text)  # after the modules that it imports

    for name in names:
        add(name)
    return f'(() => {{\n"use strict";\nconst modules = {{}};\n{"".join(modules.values())}return modules;\n}})()'


def _module(name: str, text: str) -> str:
    exports = " ".join(f"get {exported}() {{ return {exported}; }}," for _, exported in _EXPORT.findall(text))
    body = _EXPORT.sub(r"\1", _IMPORT.sub(_constants, text))
    if other := _OTHER.search(body):
        raise ValueError(f"{name}.js: cannot bundle {other[0]!r}")
    return f"modules.{name} = (() => {{\n{body}return {{ {exports} }};\n}})();\n"


def _constants(match: re.Match[str]) -> str:
    wanted, name = match.groups()
    return f"const {wanted.removeprefix('* as ').replace(' as ', ': ')} = modules.{name};\n" if wanted else ""
