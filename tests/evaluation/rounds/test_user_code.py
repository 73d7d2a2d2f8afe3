"""The hash of a user's code changes with the files that the code reaches, and with no others."""

from pathlib import Path

import pytest

from pacman_env.evaluation.rounds.user_code import hash_of_code, hash_of_files

PROJECT = {
    "box/__init__.py": "",
    "box/policy.py": """
from pathlib import Path
import numpy as np
import library
from box import helper
from box.base import Base

NET = Path(__file__).parent / "nets" / "net.txt"
LARGE = Path(__file__).with_suffix(".npz")

def mine(number):
    from lazy import part
    load("best"), load(f"model_{number}.pt"), load("../up.bin")
    return make_policy("inner:Policy")
""",
    "box/helper.py": "",
    "box/base.py": "from .sub import deep",
    "box/sub/deep.py": "",
    "lazy/part.py": "",
    "inner.py": "",
    "box/nets/net.txt": "1",
    "box/policy.npz": "2",
    "box/model_3.pt": "3",
    "best.zip": "4",
    "up.bin": "5",
    "site-packages/library-1.0.dist-info/RECORD": "library/__init__.py,sha256=1,0",
    "site-packages/library-1.0.dist-info/METADATA": "Name: library\nVersion: 1.0\n",
}
UNRELATED = ("box/unused.py", "box/log.txt", "best.json", "results/net.txt", "site-packages/library/__init__.py")


@pytest.fixture
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for name, text in (PROJECT | dict.fromkeys(UNRELATED, "")).items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    monkeypatch.syspath_prepend(tmp_path / "site-packages")
    monkeypatch.syspath_prepend(tmp_path)
    return tmp_path


@pytest.mark.parametrize("name", [*(name for name in PROJECT if not name.endswith("METADATA")), *UNRELATED])
def test_hash_changes_with_reached_files_only(project: Path, name: str) -> None:
    before = hash_of_code("box.policy")
    assert before == hash_of_code("box.policy")
    with (project / name).open("a") as file:
        file.write("#")
    assert (hash_of_code("box.policy") != before) == (name in PROJECT)


def test_hash_ignores_place_of_project(project: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = hash_of_code("box.policy")
    moved = project.rename(project.with_name("moved"))
    monkeypatch.syspath_prepend(moved / "site-packages")
    monkeypatch.syspath_prepend(moved)
    assert hash_of_code("box.policy") == before


def test_module_of_installed_package_is_hashed(project: Path) -> None:
    before = hash_of_code("library")
    (project / "site-packages/library/__init__.py").write_text("#")
    assert hash_of_code("library") != before


def test_large_file_counts_by_time_of_change(project: Path) -> None:
    with (project / "best.zip").open("r+b") as file:
        file.truncate(1 << 30)  # without content, so it is fast
    before = hash_of_code("box.policy")
    (project / "best.zip").touch()
    assert hash_of_code("box.policy") != before


def test_limit_of_modules_is_reported(project: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for number in range(201):
        (project / f"chain_{number}.py").write_text(f"import chain_{number + 1}")
    before = hash_of_code("chain_0")
    assert "chain_0: " in (told := capsys.readouterr().err)
    assert "200" in told
    (project / "chain_199.py").write_text("#")
    assert hash_of_code("chain_0") != before


def test_own_modules_of_package_have_no_hash() -> None:
    assert hash_of_code("pacman_env.heuristics.simple", "json", None) is None


def test_hash_of_files_depends_on_content_only(tmp_path: Path) -> None:
    hashes = []
    for suffix in (".zip", ".facts.json"):
        for name in ("run", "same"):
            (tmp_path / f"{name}{suffix}").write_text(suffix)
        hashes += [hash_of_files(tmp_path / f"{name}.zip") for name in ("run", "same")]
    assert hashes[0] == hashes[1] != hashes[2] == hashes[3]
