"""What is built from definitions carries messages, and what fails leaves nothing behind."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tools.ros_interfaces import build
from tools.ros_interfaces.build import find_packages

pip_ros = pytest.mark.skipif(
    not (build.PREFIX / "share" / "rosidl_generator_c").is_dir(),
    reason="ROS comes from the system, nothing is built here",
)
#: Publishes a message of the package that was built and receives it.
EXCHANGE = """
import rclpy
from tiny_msgs.msg import Tiny
rclpy.init()
node = rclpy.create_node("exchange")
received = []
node.create_subscription(Tiny, "tiny", received.append, 1)
publisher = node.create_publisher(Tiny, "tiny", 1)
for _ in range(100):
    publisher.publish(Tiny(numbers=[1, 2], words=["a"]))
    rclpy.spin_once(node, timeout_sec=0.1)
    if received:
        break
print(received[0].numbers.tolist(), received[0].words, received[0].at.position.x, Tiny.ANSWER)
node.destroy_node()
rclpy.shutdown()
"""


def write(folder: Path, **files: str) -> Path:
    """Definitions in a package ``tiny_msgs``: ``msg__Tiny="..."`` is ``msg/Tiny.msg``."""
    for name, text in files.items():
        kind, _, stem = name.partition("__")
        path = folder / "tiny_msgs" / kind / f"{stem}.{kind}"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return folder


def tiny(folder: Path) -> Path:
    return write(
        folder,
        msg__Tiny="# a comment\nint32 ANSWER=42\nint32[] numbers\nstring[<=3] words\nPart[2] parts\n"
        "geometry_msgs/Pose at\n",
        msg__Part="bool on\t true\n",
    )


def test_own_definitions_are_those_of_topics() -> None:
    packages = {package.name: package.types for package in find_packages(build.HERE)}
    assert packages == {
        "irobot_create_msgs": [
            *(("action", name) for name in ("AudioNoteSequence", "Dock", "Undock")),
            *(("msg", name) for name in ("AudioNote", "AudioNoteVector", "DockStatus", "HazardDetection")),
            *(("msg", name) for name in ("HazardDetectionVector", "LedColor", "LightringLeds")),
        ],
        "nav2_msgs": [("action", "NavigateToPose"), ("srv", "ClearEntireCostmap")],
        "tf2_msgs": [("msg", "TFMessage")],
    }


def test_importable_packages_are_left_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    tiny(tmp_path)
    (tmp_path / "tiny_msgs").rename(tmp_path / "std_msgs")
    for path in (tmp_path / "std_msgs" / "msg").iterdir():
        path.unlink()
    (tmp_path / "std_msgs" / "msg" / "String.msg").write_text("string data\n")
    assert build.main(["--definitions", str(tmp_path)]) == 0
    assert "nothing to do" in capsys.readouterr().out
    (tmp_path / "std_msgs" / "msg" / "Strong.msg").write_text("string data\n")
    assert build.main(["--definitions", str(tmp_path)]) == 2
    assert "std_msgs is installed, but without std_msgs/msg/Strong: update it" in capsys.readouterr().err


@pip_ros
@pytest.mark.skipif(not os.environ.get("CI") and not shutil.which("g++"), reason="no compiler")
def test_built_package_carries_messages(domain: int, tmp_path: Path) -> None:
    (package,) = find_packages(tiny(tmp_path / "definitions"))
    wheel = build.build_wheel([package], tmp_path / "wheel")
    prefix = tmp_path / "prefix"
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "install", "--quiet", "--no-index", "--no-deps"]
    subprocess.run([*pip, "--ignore-installed", "--prefix", str(prefix), str(wheel)], check=True)
    (site,) = prefix.glob("lib/python*/site-packages")
    environment = {
        **os.environ,
        "PYTHONPATH": str(site),
        "LD_LIBRARY_PATH": f"{prefix / 'lib'}{os.pathsep}{os.environ['LD_LIBRARY_PATH']}",
    }
    done = subprocess.run(
        [sys.executable, "-c", EXCHANGE], env=environment, capture_output=True, text=True, timeout=300
    )
    # Among its lines, for the middleware prints its own complaints on stdout.
    assert "[1, 2] ['a'] 0.0 42" in done.stdout.splitlines(), done.stdout + done.stderr
