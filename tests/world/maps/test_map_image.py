import struct
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pacman_env.world.maps.occupancy import load_map
from tests.world.map_files import chunk, pgm, png, refusal, row, write_map


@pytest.mark.parametrize(
    ("image", "grey"),
    [
        (pgm([[0, 60, 205, 255]]), [0, 60, 205, 255]),
        (pgm([[0, 60, 205, 255]], magic="P2"), [0, 60, 205, 255]),
        (pgm([[0, 50, 99, 100]], maxval=100), [0, 128, 252, 255]),  # 127.5 up, 252.45 down
        (pgm([[0, 128, 129, 65535]], maxval=65535), [0, 0, 1, 255]),  # 0.498, 0.502
        (pgm([[0, 500, 750, 1000]], maxval=1000, magic="P2"), [0, 128, 191, 255]),  # 127.5, 191.25
        (png(4, 0, 8, bytes([0, 60, 205, 255])), [0, 60, 205, 255]),
        (png(4, 0, 16, struct.pack(">4H", 0, 128, 129, 65535)), [0, 0, 1, 255]),
        (png(4, 0, 1, bytes([0b0110_0000])), [0, 255, 255, 0]),
        (png(4, 0, 4, bytes([0x0F, 0x3A])), [0, 255, 51, 170]),
        (png(4, 3, 8, bytes([0, 1, 1, 0]), chunk(b"PLTE", bytes([254, 254, 254, 255, 0, 0]))), [254, 76, 76, 254]),
        (png(4, 2, 8, bytes([255, 0, 0, 0, 255, 0, 0, 0, 255, 9, 9, 9])), [76, 150, 29, 9]),
        (cv2.imencode(".bmp", np.array([[0, 60, 205, 255]], np.uint8))[1].tobytes(), [0, 60, 205, 255]),
        (cv2.imencode(".bmp", np.array([[[9, 9, 9, 0]] * 4], np.uint8))[1].tobytes(), [9] * 4),
    ],
)
def test_brightness_is_that_of_the_image_format(tmp_path: Path, image: bytes, grey: list[int]) -> None:
    m = load_map(write_map(tmp_path, image))
    assert m.grey.tolist() == [grey]
    assert (m.grey.dtype, m.occupancy.dtype) == (np.uint8, np.int8)


@pytest.mark.parametrize(
    "image",
    [
        png(3, 4, 8, bytes([255, 255, 255, 254, 0, 0])),
        png(3, 4, 16, struct.pack(">6H", 65535, 65535, 65535, 65000, 0, 0)),
        png(3, 6, 8, bytes([255, 255, 255, 255, 255, 255, 255, 254, 0, 0, 0, 0])),
        png(3, 3, 8, bytes([0, 1, 2]), chunk(b"PLTE", bytes([255] * 6 + [0] * 3)), chunk(b"tRNS", b"\xff\xfe\0")),
        png(3, 0, 8, bytes([255, 0, 0]), chunk(b"tRNS", struct.pack(">H", 0))),
        png(3, 0, 16, struct.pack(">3H", 65535, 65534, 65534), chunk(b"tRNS", struct.pack(">H", 65534))),
    ],
)
def test_transparent_cells_are_unknown_and_dark(tmp_path: Path, image: bytes) -> None:
    for mode in ("trinary", "scale"):
        m = load_map(write_map(tmp_path, image, mode=mode))
        assert row(m) == [0, -1, -1]
        assert m.grey[0].tolist() == [255, 0, 0]


def test_raw_ignores_alpha_only_for_the_costmap(tmp_path: Path) -> None:
    m = load_map(write_map(tmp_path, png(2, 4, 8, bytes([60, 255, 60, 0])), mode="raw"))
    assert row(m) == [60, 60]
    assert m.grey[0].tolist() == [60, 0]


@pytest.mark.parametrize(
    ("image", "reason"),
    [
        (b"GIF89a" + bytes(50), "neither PGM"),
        (pgm([[1, 2, 3]])[:-1], "cut off after 2 of 3"),
        (b"P2 2 1 255\n1 -2", "not a number"),
        (b"P2 2 1 255\n1", "cut off after 1 of 2"),
        (b"P5 1 1 0\n\0", "maxval 0"),
        (b"P5 0 1 255\n", "0 x 1 pixels"),
        (b"P5 10001 1 255\n" + bytes(10001), "10001 x 1 pixels"),
        (png(3, 0, 8, bytes(3))[:50], "broken image"),
        (png(100_000, 0, 8, b"", height=100_000), "100000 x 100000 pixels"),
        (b"BM" + bytes(16) + struct.pack("<ii", 5, -20_000) + bytes(50), "5 x 20000 pixels"),
        (b"BM" + bytes(16) + struct.pack("<ii", 5, 2) + bytes(50), "broken image"),
    ],
)
def test_bad_image_is_refused_by_name(tmp_path: Path, image: bytes, reason: str) -> None:
    message = refusal(path := write_map(tmp_path, image))
    assert all(part in message for part in (reason, str(path), "key 'image'", str(tmp_path / "m.pgm"))), message


@given(data=st.binary(max_size=60), magic=st.sampled_from([b"", b"P5 2 2 255\n", b"P2 2 2 9\n", b"BM"]))
def test_any_image_raises_only_map_errors(tmp_path_factory: pytest.TempPathFactory, data: bytes, magic: bytes) -> None:
    message = refusal(write_map(tmp_path_factory.getbasetemp(), magic + data))
    assert message == "" or "key 'image'" in message
