"""The sdist is the checkout; the wheel built from it plays every shipped map without the checkout."""

import email
import email.message
import json
import os
import re
import shutil
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path
from typing import Any

import pytest

import pacman_env
from pacman_env.world.maps.occupancy import shipped_maps

ROOT = Path(__file__).resolve().parents[1]
#: Tracked files that are the repository's alone.
NOT_PACKED = (".ci/", ".github/", ".gitattributes", ".gitignore", ".pre-commit-config.yaml", "MANIFEST.in")

#: Run with the installed wheel first on the path: where things come from, a game on each map, and what was compiled.
PLAY = """
import json, sys
import gymnasium, pacman_env
from numba.core import event
compiled = []
class Listener(event.Listener):
    def on_start(self, event):
        compiled.append(str(event.data["dispatcher"]))
    def on_end(self, event):
        pass
event.register("numba:compile", Listener())
from pacman_env.world.maps import occupancy
rounds = {}
for name in occupancy.shipped_maps():
    env = gymnasium.make("pacman_env/PacManBot-v2", map=name)
    _, info = env.reset(seed=0)
    rounds[name] = [info["spawned"], env.unwrapped.batch.assets.occupancy.hash]
folders = sorted({str(path.parent) for path in occupancy._shipped().values()})
print(json.dumps({"package": pacman_env.__file__, "version": pacman_env.__version__, "rounds": rounds,
                  "folders": folders, "compiled": compiled}))
"""


def run(*command: str, cwd: Path, site: Path | None = None, **environment: str) -> str:
    """Output and errors of a command that has to succeed; with what is installed in ``site`` first on the path."""
    if site is not None:
        environment["PYTHONPATH"] = str(site)
    result = subprocess.run(
        command, cwd=cwd, env={**os.environ, **environment}, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    assert result.returncode == 0, result.stdout
    return result.stdout


def test_folder_named_like_the_package_does_not_hide_it(tmp_path: Path) -> None:
    """A clone is such a folder, for scripts in the folder that contains it."""
    (tmp_path / "pacman_env").mkdir()
    show = [sys.executable, "-c", "import pacman_env; print(pacman_env.__version__)"]
    assert run(*show, cwd=tmp_path, PYTHONPATH="").strip() == pacman_env.__version__


@pytest.fixture(scope="module")
def tracked() -> list[str]:
    """Files of the checkout, by their paths in it."""
    if not (ROOT / ".git").exists():
        pytest.skip("no checkout")
    names = run("git", "ls-files", "-z", cwd=ROOT).split("\0")
    return [name for name in names if name and (ROOT / name).exists()]


@pytest.fixture(scope="module")
def distributions(tracked: list[str], tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path, str]:
    """The sdist, built from a clean checkout, the wheel that is built from the sdist, and what the builds said."""
    source = tmp_path_factory.mktemp("source")
    for name in tracked:
        (source / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, source / name)
    out = tmp_path_factory.mktemp("dist")
    build = [sys.executable, "-m", "build", "--no-isolation", "--outdir", str(out), "."]
    said = run(*build, cwd=source, PYTHONDONTWRITEBYTECODE="")  # setuptools mentions it where it is set
    sdist, wheel = (out / name for name in sorted(path.name for path in out.iterdir())[::-1])
    return sdist, wheel, said


@pytest.fixture(scope="module")
def site(distributions: tuple[Path, Path, str], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the wheel installed, without its dependencies."""
    folder = tmp_path_factory.mktemp("installed") / "site"
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "install", "--quiet", "--no-index", "--no-deps"]
    run(*pip, "--target", str(folder), str(distributions[1]), cwd=folder.parent)
    return folder


@pytest.fixture(scope="module")
def played(site: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """What :data:`PLAY` prints, after the checkout has played the same."""
    run(sys.executable, "-W", "error", "-c", PLAY, cwd=ROOT, site=ROOT)
    elsewhere = tmp_path_factory.mktemp("elsewhere")
    out = run(sys.executable, "-W", "error", "-c", PLAY, cwd=elsewhere, site=site)
    return json.loads(out.splitlines()[-1])


def test_build_prints_no_warnings(distributions: tuple[Path, Path, str]) -> None:
    complaints = ("warn", "!!", "deprecat", "cannot be found")
    nothing_excluded = "warning: no previously-included files matching '*.py[cod]'"  # a clean checkout has none
    said = [line for line in distributions[2].splitlines() if not line.startswith(nothing_excluded)]
    assert [line for line in said if any(word in line.lower() for word in complaints)] == []


def test_sdist_contains_exactly_the_tracked_project_files(
    distributions: tuple[Path, Path, str], tracked: list[str]
) -> None:
    with tarfile.open(distributions[0]) as archive:
        packed = {name.name.partition("/")[2] for name in archive.getmembers() if name.isfile()}
    written = {name for name in packed if name.startswith("pacman_env.egg-info/")} | {"PKG-INFO"}
    assert packed - written - {"MANIFEST.in"} == {name for name in tracked if not name.startswith(NOT_PACKED)}


@pytest.fixture(scope="module")
def metadata(distributions: tuple[Path, Path, str]) -> email.message.Message:
    with zipfile.ZipFile(distributions[1]) as wheel:
        (name,) = [name for name in wheel.namelist() if name.endswith(".dist-info/METADATA")]
        return email.message_from_string(wheel.read(name).decode())


def test_wheel_metadata_describes_project(metadata: email.message.Message) -> None:
    assert metadata["Version"] == pacman_env.__version__
    assert metadata["License"] == "MIT"
    assert metadata["Requires-Python"] == ">=3.11"
    assert "reinforcement learning" in metadata["Keywords"].split(",")
    assert "Programming Language :: Python :: 3.11" in metadata.get_all("Classifier", [])
    assert str(metadata.get_payload()).startswith("# pacman_env\n")


def test_package_index_shows_films_and_no_dead_link(metadata: email.message.Message) -> None:
    markdown = pytest.importorskip("readme_renderer.markdown", reason="pip install 'readme_renderer[md]'")
    urls = dict(url.split(", ") for url in metadata.get_all("Project-URL", []))
    assert urls.keys() == {"Documentation", "Source", "Issues", "Changelog"}
    page = markdown.render(metadata.get_payload())
    assert re.search(r'<img [^>]*src="https://[^"]*/docs/images/round.webp"', page)
    links = re.findall(r' (?:src|href)="([^"]*)', page)
    own = rf"{re.escape(urls['Source'])}/(?:raw|blob)/v{pacman_env.__version__}/([^#]*)"
    files = [match[1] for link in (*links, *urls.values()) if (match := re.match(own, link))]
    assert {"docs/images/round.webp", "docs/index.md", "CHANGELOG.md"} <= set(files)
    assert all((ROOT / file).exists() for file in files)
    assert all(link.startswith("https://") or (link[0] == "#" and f'id="{link[1:]}"' in page) for link in links)


def test_wheel_contains_exactly_package_maps_and_planners(distributions: tuple[Path, Path, str]) -> None:
    _, wheel, _ = distributions
    packed = {name for name in zipfile.ZipFile(wheel).namelist() if ".dist-info/" not in name}
    package = {path.relative_to(ROOT).as_posix() for path in (ROOT / "pacman_env").rglob("*.py")}
    package |= {f"pacman_env/evaluation/templates/{page}.j2" for page in ("compare.html", "replay.html")}
    package |= {"pacman_env/evaluation/suites/leaderboard.yaml"}
    package |= {f"pacman_env/training/hyperparameters/{name}.yaml" for name in ("PacManBot-v2", "baselines")}
    maps = {f"pacman_env/maps/{path.name}" for path in (ROOT / "maps").iterdir() if path.suffix in (".yaml", ".pgm")}
    planner = {
        f"pacman_env/policies/pretrained/{name}.{kind}" for name in ("ppo", "clyde") for kind in ("onnx", "json")
    }
    static = (ROOT / "pacman_env/web/static").rglob("*.*")
    page = {path.relative_to(ROOT).as_posix() for path in static}
    assert packed == package | maps | planner | page | {"pacman_env/py.typed", "pacman_env/ros/udp_alone.xml"}
    assert wheel.name == f"pacman_env-{pacman_env.__version__}-py3-none-any.whl"


def test_every_shipped_map_is_playable_from_wheel(played: dict[str, Any], site: Path) -> None:
    assert Path(played["package"]) == site / "pacman_env" / "__init__.py"
    assert played["version"] == pacman_env.__version__
    assert list(played["rounds"]) == shipped_maps()
    assert played["folders"] == [str(site / "pacman_env" / "maps")]
    assert all(pellets > 0 for pellets, _ in played["rounds"].values())
    assert len({content for _, content in played["rounds"].values()}) == len(played["rounds"])
    assert played["compiled"] == []  # a checkout that is warm shares its kernels


def test_installed_command_compares_policies_in_empty_folder(site: Path, tmp_path: Path) -> None:
    """With workers, to which blocks of rounds are pickled by the names of the installed package."""
    script = [sys.executable, str(site / "bin" / "pacman-env")]
    short = ["--episodes", "2", "--time-limit", "20", "--policies", "nearest", "random_pellet", "--workers", "2"]
    out = run(
        *script,
        "compare",
        *short,
        "--json",
        "results/numbers.json",
        "--html",
        "results/page.html",
        cwd=tmp_path,
        site=site,
    )
    assert "written: results/numbers.json, results/numbers.png" in out
    assert "<table" in (tmp_path / "results" / "page.html").read_text()
    found = {path.name for path in (tmp_path / "results").iterdir()}
    assert found == {"numbers.json", "numbers.parts", "numbers.png", "page.html"}


@pytest.mark.daily
def test_installed_command_compares_checkpoint_of_checkout(site: Path, tmp_path: Path) -> None:
    pytest.importorskip("torch")
    tiny = ["--decisions", "64", "--segment", "64", "--games", "2", "--n-steps", "32", "--batch-size", "32"]
    tiny += ["--ghosts", "wander"]
    tiny += ["--imitation", "0", "--levels", "2", "--evaluation", "0", "--threads", "1", "--no-progress"]
    run(sys.executable, "train/ppo.py", *tiny, "--out", str(tmp_path / "run"), cwd=ROOT, PYTHONPATH=str(ROOT))
    command = ["compare", "--episodes", "2", "--time-limit", "5", "--policies", "run/last.zip"]
    out = run(sys.executable, str(site / "bin" / "pacman-env"), *command, cwd=tmp_path, site=site)
    assert "last " in out
