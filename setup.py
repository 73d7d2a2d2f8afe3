"""Build the package: addresses, data outside of the package folder, and an ament_python package for colcon.

pyproject.toml cannot describe these. Ubuntu 24.04's setuptools (68) does not know a licence that is a plain string
there, and colcon cannot read ``requires-python`` there: so both are here.
"""

import re
import runpy
import sys
from pathlib import Path
from xml.etree import ElementTree

from setuptools import find_packages, setup

NAME = "pacman_env"
ROOT = Path(__file__).resolve().parent
#: Folders of the checkout, by the name that they have in the installed package (``pacman_env.files.shipped``).
DATA = {
    f"{NAME}.maps": "maps",
    f"{NAME}.evaluation.suites": "eval/suites",
    f"{NAME}.training.hyperparameters": "train/hyperparameters",
}
SHARED = ("launch/*.py", "config/*", "maps/*.yaml", "maps/*.pgm")
PACKAGE = ElementTree.parse(ROOT / "package.xml")  # the one file with the public addresses
URLS = {url.get("type"): url.text for url in PACKAGE.iter("url")}
SOURCE, TAG = URLS["repository"].removesuffix(".git"), f"v{PACKAGE.findtext('version')}"


def absolute(link: re.Match[str]) -> str:
    """Return the beginning of a link of README with the address of its file at this version."""
    start, path = link.groups()
    return f"{start}{SOURCE}/{'raw' if path.endswith(('.png', '.svg', '.webp')) else 'blob'}/{TAG}/{path}"


def complete(build: Path, source: Path) -> None:
    """Link into colcon's build folder what ``colcon build --symlink-install`` leaves out.

    Colcon links the folder ``pacman_env`` alone, not pyproject.toml and not the folders of data beside it.
    """
    for name in ("pyproject.toml", "LICENSE", *(folder.partition("/")[0] for folder in DATA.values())):
        if not (build / name).exists():
            (build / name).symlink_to(source / name)


if "develop" in sys.argv and Path(__file__).is_symlink():
    complete(Path(__file__).absolute().parent, Path(__file__).resolve().parent)
    from setuptools.command.easy_install import CommandSpec  # gone from 80 on, as is this way to build

    # As in setup.cfg, which this way does not read: not colcon's own interpreter, which lacks what pip installed.
    CommandSpec.from_environment = classmethod(lambda spec: spec(["/usr/bin/env", "python3"]))

commands = [f"pacman-env = {NAME}.cli.main:main"]
data_files = []
if not {"bdist_wheel", "dist_info", "editable_wheel"} & set(sys.argv):  # pip's way: no ten commands on a user's path
    nodes = runpy.run_path(str(Path(__file__).with_name(NAME) / "ros" / "game_nodes.py"))
    commands += [f"{name} = {module}:main" for name, module in nodes["MODULES"].items()]  # of `ros2 run`
    data_files = [
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        *((f"share/{NAME}/{path.parent}", [str(path)]) for pattern in SHARED for path in sorted(Path().glob(pattern))),
    ]

setup(
    packages=[*find_packages(include=[NAME, f"{NAME}.*"]), *DATA],
    package_dir=DATA,
    license="MIT",
    python_requires=">=3.11",
    long_description=re.sub(  # package indexes show it, far from the files that README links to
        r'(\]\(|(?:href|src|srcset)=")(?!https?:|#)([^)"\s]+)', absolute, (ROOT / "README.md").read_text("utf-8")
    ),
    long_description_content_type="text/markdown",
    project_urls={
        "Documentation": URLS["website"],
        "Source": SOURCE,
        "Issues": URLS["bugtracker"],
        "Changelog": f"{SOURCE}/blob/{TAG}/CHANGELOG.md",
    },
    entry_points={"console_scripts": commands},
    data_files=data_files,
)
