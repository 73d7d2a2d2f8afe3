import math
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from pacman_env import files
from pacman_env.world.maps.occupancy import MapError, OccupancyMap, load_map, shipped_maps
from tests.world.map_files import GOOD, pgm, refusal, row, write_map

# --- brightness to occupancy -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("greys", "keys", "expected"),
    [
        # 1 - g / 255: 89 -> 0.651, 90 -> 0.647, 205 -> 0.1961, 206 -> 0.1922
        ([0, 89, 90, 205, 206, 255], {}, [100, 100, -1, -1, 0, 0]),
        ([0, 1, 254, 255], {"occupied_thresh": 1.0, "free_thresh": 0.0}, [100, -1, -1, 0]),
        # 1 - 153 / 255 is 0.4 in double precision, and just below the threshold in single precision
        ([153, 152], {"occupied_thresh": 0.4}, [-1, 100]),
        # 0.4 is dark enough to be occupied and bright enough to be free: it is free
        ([0, 153, 255], {"occupied_thresh": 0.3, "free_thresh": 0.7}, [100, 0, 0]),
        ([0, 153, 255], {"occupied_thresh": 0.3, "free_thresh": 0.7, "mode": "scale"}, [100, 0, 0]),
        # (1 - g / 255 - 0.196) / 0.454: 90 -> 0.9935, 128 -> 0.6653, 147 -> 0.5012, 205 -> 0.0002
        ([0, 89, 90, 128, 147, 205, 206, 255], {"mode": "scale"}, [100, 100, 99, 67, 50, 0, 0, 0]),
        ([0, 50, 100, 101, 128, 255], {"mode": "raw", "negate": 1}, [0, 50, 100, -1, -1, -1]),
    ],
)
def test_brightness_becomes_occupancy(
    tmp_path: Path, greys: list[int], keys: dict[str, Any], expected: list[int]
) -> None:
    assert row(load_map(write_map(tmp_path, [greys], **keys))) == expected


def test_negate_makes_dark_cells_free(tmp_path: Path) -> None:
    # g / 255: 49 -> 0.192, 50 -> 0.1961, 166 -> 0.651
    m = load_map(write_map(tmp_path, [[0, 49, 50, 166, 255]], negate=1))
    assert row(m) == [0, 0, -1, 100, 100]
    assert m.grey[0].tolist() == [255, 206, 205, 89, 0]
    assert m.game_free()[0].tolist() == [True, False, False, False, False]


def test_mode_is_read_in_any_case_or_trinary(tmp_path: Path) -> None:
    for mode in ("Trinary", "SCALE", "rAw"):
        assert load_map(write_map(tmp_path, [[60]], mode=mode)).mode == mode.lower()
    assert load_map(write_map(tmp_path, [[60]])).mode == "trinary"


def test_image_path_is_relative_to_yaml_or_absolute(tmp_path: Path) -> None:
    (tmp_path / "images").mkdir()
    (tmp_path / "images" / "other.pgm").write_bytes(pgm([[7]]))
    for image in ("images/other.pgm", str(tmp_path / "images" / "other.pgm")):
        assert load_map(write_map(tmp_path, [[0]], image=image)).grey.tolist() == [[7]]


# --- keys --------------------------------------------------------------------------------------------------


def test_missing_key_is_named(tmp_path: Path) -> None:
    for key in GOOD:
        message = refusal(path := write_map(tmp_path, [[0]], key))
        assert f"key '{key}' is missing" in message
        assert str(path) in message


NOT_A_NUMBER = ["a", None, [1], True, "-nan", math.inf, 10**400, "0x1", "1_0", "1:30", "0b1", " 0.1", "\u0660.\u0661"]
WRONG: dict[str, list[object]] = {
    "resolution": [*NOT_A_NUMBER, 0, -0.1],
    "occupied_thresh": [*NOT_A_NUMBER, -0.1, 65],
    "free_thresh": [*NOT_A_NUMBER, -0.1, 1.01],
    "origin": [0, "0 0 0", None, [0, 0], [0, 0, 0, 0], [0, 0, "a"], [0, 0, math.nan], [0, [0], 0]],
    "negate": ["maybe", 0.0, None, [0], "", "tRUE", "08", " 1", "1_0"],
    "mode": ["trinaryy", "", None, 3, ["raw"]],
    "image": ["", None, 5, ["m.pgm"], "absent.pgm", ".", "a\0b", "x" * 5000],
}


@pytest.mark.parametrize("key", WRONG)
def test_wrong_value_is_refused_by_file_and_key(tmp_path: Path, key: str) -> None:
    for value in WRONG[key]:
        message = refusal(path := write_map(tmp_path, [[0]], **{key: value}))
        assert f"key '{key}'" in message
        assert str(path) in message


def test_numbers_read_as_strings_are_numbers(tmp_path: Path) -> None:
    text = "image: m.pgm\nresolution: 5e-2\norigin: [1e0, '-2', 3]\nnegate: '0'\noccupied_thresh: 65e-2\n"
    path = write_map(tmp_path, [[255]])
    path.write_text(text + "free_thresh: 1e-1\n")
    m = load_map(path)
    assert (m.resolution, m.origin, m.occupied_thresh, m.free_thresh) == (0.05, (1.0, -2.0, 3.0), 0.65, 0.1)


def test_values_are_read_as_by_yaml_cpp(tmp_path: Path) -> None:
    """As yaml-cpp 0.7.0 and 0.8.0 read what stands behind the key of a number."""
    same = (".05", "5e-2", "+0.05", "'0.05'", "!!str 0.05", "0.05\t# tab", "0.05 # m", "05E-2")
    for text, number in (*((text, 0.05) for text in same), ("010", 10.0), ("5.", 5.0), ("1e2", 100.0)):
        path = write_map(tmp_path, [[0]], "resolution")
        path.write_text(path.read_text() + f"resolution: {text}\n")
        assert load_map(path).resolution == number
    for value in (0, False, "n", "NO", "0x0", "00", "-0"):
        assert load_map(write_map(tmp_path, [[0]], negate=value)).negate is False
    for value in (1, 2, True, "1", "On", "010", "0X1", "+1"):
        assert load_map(write_map(tmp_path, [[0]], negate=value)).negate is True


NO_MAPPING = ["", "- 1", "just words", "a: [", 'image: "\\UFFFFFFFF"', "\tx: 1", "a: !!bool maybe", "a: 2024-13-45"]


@pytest.mark.parametrize("text", [*NO_MAPPING, "a: !!python/object/apply:os.getcwd []", "? [1]\n: 2", "[" * 1500])
def test_yaml_without_a_plain_mapping_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "m.yaml"
    path.write_text(text)
    with pytest.raises(MapError, match=r"m\.yaml: "):
        load_map(path)


@given(data=st.binary(max_size=40), key=st.sampled_from(list(GOOD)))
def test_any_yaml_raises_only_map_errors(tmp_path_factory: pytest.TempPathFactory, data: bytes, key: str) -> None:
    path = write_map(tmp_path_factory.getbasetemp(), [[0]], key)
    path.write_bytes(path.read_bytes() + f"{key}: ".encode() + data)
    message = refusal(path)
    assert message == "" or str(path) in message


TEXT = "image: m.pgm\nresolution: 0.05\norigin: [0, 0, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"


@pytest.mark.parametrize(
    "text",
    [
        TEXT.replace(": ", "\t: \t").replace("\n", "\t\n").replace(", ", ",\t"),
        TEXT.replace("\n", "\r\n"),
        f"%YAML 1.2\n---\n{TEXT}...\n",
        f"---\n{TEXT}---\nresolution: [0.1\n",
        f"{TEXT}author: !someone {{? [a] : b, when: 2024-13-45}}\n",
        "<<: {mode: raw, resolution: 1}\n" + TEXT,
        TEXT.replace("resolution: 0.05", "d: &d {resolution: 1}\n'resolution': 0.05\n<<: *d"),
        "{\n\t" + TEXT.replace("\n", ",\n\t") + "}",
    ],
    ids=lambda text: repr(text)[:20],
)
def test_yaml_syntax_is_that_of_yaml_cpp(tmp_path: Path, text: str) -> None:
    path = write_map(tmp_path, [[255]])
    path.write_bytes(text.encode())
    m = load_map(path)
    assert (m.resolution, m.origin, m.mode, m.notes) == (0.05, (0.0, 0.0, 0.0), "trinary", ())


def test_first_of_repeated_keys_counts(tmp_path: Path) -> None:
    path = write_map(tmp_path, [[255]])
    path.write_text(f"{TEXT}'resolution': 0.1\nauthor: a\nauthor: b\nresolution: [\n1]\nimage: absent.pgm\n")
    m = load_map(path)
    assert m.resolution == 0.05
    assert len(m.notes) == 2
    assert "'image' is in lines 1 and 12" in m.notes[0]
    assert "'resolution' is in lines 2 and 7 and 10" in m.notes[1]


def test_alias_bomb_makes_no_long_message(tmp_path: Path) -> None:
    path = write_map(tmp_path, [[0]], "image")
    bomb = "a0: &a0 [x,x,x,x,x,x,x,x]\n"
    bomb += "".join(f"a{i + 1}: &a{i + 1} [{','.join([f'*a{i}'] * 8)}]\n" for i in range(12))
    path.write_text(bomb + path.read_text() + "image: *a12\n")
    message = refusal(path)
    assert "key 'image'" in message
    assert len(message) < 1_000_000


# --- names and folders -------------------------------------------------------------------------------------


def test_folder_with_one_yaml_is_a_map(tmp_path: Path) -> None:
    folder = tmp_path / "kitchen"
    folder.mkdir()
    path = write_map(folder, [[0]])
    assert load_map(folder).name == "kitchen"
    assert load_map(str(path)).name == "m"
    path.rename(folder / "map.yaml")
    assert load_map(folder / "map.yaml").name == "kitchen"
    (folder / "other.yaml").touch()
    for several, count in ((folder, 2), (tmp_path, 0)):
        with pytest.raises(MapError, match=f"exactly one .yaml file, this one {count}"):
            load_map(several)


@pytest.mark.parametrize("layout", ["wheel", "checkout"])
def test_shipped_maps_are_found_in_both_layouts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, layout: str) -> None:
    package = tmp_path / "pacman_env"
    maps = (package if layout == "wheel" else tmp_path) / "maps"
    maps.mkdir(parents=True)
    write_map(maps, [[254]]).rename(maps / "attic.yaml")
    monkeypatch.setattr(files, "__file__", str(package / "files.py"))
    assert shipped_maps() == ["attic"]
    assert load_map("attic").name == "attic"
    with pytest.raises(MapError, match=r"attik: .*attic"):
        load_map("attik")


def test_absent_source_is_named() -> None:
    for source in ("nowhere.yaml", "~no_such_user_at_all/m.yaml", "x" * 5000, "a\0b"):
        with pytest.raises(MapError) as caught:
            load_map(source)
        assert source in str(caught.value)


# --- geometry ----------------------------------------------------------------------------------------------


def test_cell_centres_follow_map_server() -> None:
    m = OccupancyMap.from_pixels("m", np.zeros((3, 4), np.uint8), 0.1, (1.0, 2.0, 0.0))
    assert m.cell_to_world(0, 2) == pytest.approx((1.05, 2.05))
    assert m.cell_to_world(3, 0) == pytest.approx((1.35, 2.25))
    turned = OccupancyMap.from_pixels("m", np.zeros((3, 4), np.uint8), 0.1, (1.0, 2.0, math.pi / 2))
    assert turned.cell_to_world(3, 0) == pytest.approx((1.0 - 0.25, 2.0 + 0.35))
    x, y = turned.cell_to_world(np.array([0, 3]), np.array([2, 0]))
    np.testing.assert_allclose((x, y), [[0.95, 0.75], [2.05, 2.35]])


@given(
    column=st.integers(0, 3999),
    row=st.integers(0, 2),
    resolution=st.floats(0.001, 1.0),
    yaw=st.floats(-4, 4),
    corner=st.floats(-100, 100),
)
def test_world_to_cell_undoes_cell_to_world(
    column: int, row: int, resolution: float, yaw: float, corner: float
) -> None:
    m = OccupancyMap.from_pixels("m", np.zeros((3, 4000), np.uint8), resolution, (corner, -corner, yaw))
    assert m.world_to_cell(*m.cell_to_world(column, row)) == pytest.approx((column, row), abs=1e-6)


# --- objects and files -------------------------------------------------------------------------------------


def test_arrays_are_read_only_copies() -> None:
    pixels = np.full((2, 2), 254, np.uint8)
    m = OccupancyMap.from_pixels("m", pixels, 0.1, (0.0, 0.0, 0.0))
    pixels[:] = 0
    assert m.grey.min() == 254
    for array in (m.grey, m.occupancy):
        with pytest.raises(ValueError, match="read-only"):
            array[0, 0] = 1
    with pytest.raises(MapError, match="must be one"):  # shape
        OccupancyMap("m", np.zeros((2, 2), np.uint8), np.zeros((2, 3), np.int8), 0.1, (0, 0, 0))


def test_hash_covers_only_what_matters() -> None:
    pixels = np.array([[0, 254, 205]], np.uint8)
    other = np.array([[0, 253, 205]], np.uint8)
    place = 0.1, (0.0, 0.0, 0.0)
    base = OccupancyMap.from_pixels("a", pixels, *place)
    same = [
        OccupancyMap.from_pixels("b", pixels, *place),
        OccupancyMap.from_pixels("a", pixels, *place, free_thresh=0.1),
    ]
    different = [
        OccupancyMap.from_pixels("a", pixels, 0.2, (0.0, 0.0, 0.0)),
        OccupancyMap.from_pixels("a", pixels, 0.1, (0.0, 0.0, 0.5)),
        OccupancyMap.from_pixels("a", pixels, *place, free_thresh=0.2),
        *(OccupancyMap.from_pixels("a", grey, *place) for grey in (other, pixels.T)),
    ]
    assert len(base.hash) == 64
    assert {m.hash for m in same} == {base.hash}
    assert len({m.hash for m in [base, *different]}) == 6


@given(
    hnp.arrays(np.uint8, hnp.array_shapes(min_dims=2, max_dims=2, max_side=6)),
    st.none() | st.integers(0, 99),
    st.tuples(st.floats(1e-5, 10), st.tuples(*[st.floats(-9e3, 9e3)] * 2, st.floats(-1e6, 1e6))),
    st.fixed_dictionaries(
        {
            "occupied_thresh": st.floats(0, 1),
            "free_thresh": st.floats(0, 1),
            "negate": st.booleans(),
            "mode": st.sampled_from(["trinary", "scale", "raw"]),
        }
    ),
)
@example(np.zeros((1, 1), np.uint8), None, (5e-5, (-0.0, 1e-20, 1e16)), {"free_thresh": 5e-5})
@settings(max_examples=60)
def test_saved_map_is_loaded_again(
    tmp_path_factory: pytest.TempPathFactory, pixels: np.ndarray, alpha: int | None, place: Any, options: dict[str, Any]
) -> None:
    opaque = None if alpha is None else np.random.default_rng(alpha).random(pixels.shape) < 0.7
    m = OccupancyMap.from_pixels("m", pixels, *place, opaque=opaque, **options)
    again = load_map(m.save(tmp_path_factory.getbasetemp() / "saved.yaml"))
    np.testing.assert_array_equal(again.grey, m.grey)
    np.testing.assert_array_equal(again.occupancy, m.occupancy)
    for name in ("resolution", "origin", "hash", "negate", "mode", "occupied_thresh", "free_thresh"):
        assert getattr(again, name) == getattr(m, name)


def test_save_refuses_what_cannot_be_read_again(tmp_path: Path) -> None:
    grey = np.full((1, 2), 254, np.uint8)
    m = OccupancyMap.from_pixels("m", grey, 0.1, (0.0, 0.0, 0.0))
    for image in ("a.jpg", "folder/a.pgm", "../a.pgm", "a"):
        with pytest.raises(MapError, match=r"key 'image': .* must be a file name"):
            m.save(tmp_path / "a.yaml", image=image)
    unknown = OccupancyMap.from_pixels("m", grey, 0.1, (0, 0, 0), opaque=np.array([[True, False]]))
    with pytest.raises(MapError, match=r"need alpha, choose a \.png"):
        unknown.save(tmp_path / "a.yaml", image="a.pgm")
    contradictory = OccupancyMap("m", grey, np.array([[0, 100]], np.int8), 0.1, (0, 0, 0))
    with pytest.raises(MapError, match="no image yields both"):
        contradictory.save(tmp_path / "a.yaml")
    assert os.listdir(tmp_path) == []


@pytest.mark.parametrize("yaw", [0.0, 0.5])
def test_far_map_is_refused_with_valid_origin(yaw: float) -> None:
    free = np.full((40, 60), 254, np.uint8)
    with pytest.raises(MapError, match=r"'origin'.* 10 km .*\[-321\.5, 345\.25, ") as caught:
        OccupancyMap.from_pixels("utm", free, 0.05, (345678.5, 5512345.25, yaw))
    x, y, heading = map(float, str(caught.value).partition("set it to [")[2].partition("]")[0].split(","))
    assert OccupancyMap.from_pixels("near", free, 0.05, (x, y, heading)).origin == (-321.5, 345.25, yaw)


@pytest.mark.parametrize("x", [-10_000.0, 9_997.0])
def test_map_within_ten_kilometres_keeps_its_origin(x: float) -> None:
    free = np.full((40, 60), 254, np.uint8)
    assert OccupancyMap.from_pixels("m", free, 0.05, (x, 0.1, 0.0)).origin == (x, 0.1, 0.0)
    with pytest.raises(MapError, match="origin"):  # a corner lies beyond
        OccupancyMap.from_pixels("m", free, 0.05, (math.copysign(9_997.1, x) - 3 * (x < 0), 0.1, 0.0))


def test_map_of_undecodable_folder_has_displayable_name(tmp_path: Path) -> None:
    folder = tmp_path / os.fsdecode(b"K\xfcche")
    folder.mkdir()
    write_map(folder, [[254]]).rename(folder / "map.YAML")
    assert load_map(folder).name == load_map(folder / "map.YAML").name == "K\ufffdche"
