"""Commands refuse wrong arguments with one line and status 2, and write nothing."""

from collections.abc import Callable
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from pacman_env.cli.main import main
from pacman_env.world.maps.occupancy import OccupancyMap

MAPS = Path(__file__).resolve().parents[2] / "maps"
#: A library that a command needs and the base install does not have.
NEEDED = {"web": "starlette", "dataset": "jax", "export": "torch"}
#: What ``rounds.scenarios`` reads is refused alike in all commands; one of them is tried.
COMMANDS = [
    ("fly", "invalid choice: 'fly'"),
    ("comapre", "did you mean compare"),
    ("map", "pacman-env map: choose one of check, list, generate, turn"),
    ("ros", "pacman-env ros: choose one of up, goal_selector, start"),
    ("map chek house", "did you mean check"),
    ("map check", "the following arguments are required"),
    ("map check x --home 1", "expected 2 arguments"),
    ("map check x --home nan 0", "'nan' is not a finite number"),
    ("map check nowhere", "nowhere: neither a YAML file"),
    ("map check nowhere.yaml", "nowhere.yaml: no such file"),
    ("map check room.pgm", "room.pgm: is an image, give the YAML file"),
    ("map turn room.yaml room.yaml", "room.yaml: must be a new file"),
    ("map check room.yaml --set pellets.spacing_m=0", "pellets.spacing_m"),
    ("map check room.yaml --spacing 0.001", "room: pellets.spacing_m = 0.001: below the map's resolution"),
    ("map check broken.yaml", "key 'image' is missing"),
    ("map list foo", "pacman-env map list: unrecognized arguments: foo"),
    *(
        (f"map generate houses {levels}", "0 to 999999 (training) or 1000000 to 1000999 (test)")
        for levels in ("--count 0", "--level 1000999 --count 2", "--level 999999 --count 2")
    ),
    ("warm-up --houses -3", "--houses: -3: must be at least 0"),
    ("warm-up foo", "pacman-env warm-up: unrecognized arguments: foo"),
    ("ros doctr", "did you mean doctor"),
    ("web --seed 9007199254740992", "must be at most"),  # a browser would round it
    ("web --map nowhere", "nowhere"),
    ("web --policy run.zip", "run.zip: must be an .onnx file"),
    ("web --policy nobody", "policy 'nobody': choose one of"),
    ("web --ghosts policy", "behaviour 'policy': choose one of"),
    ("web --set action=velocity", "setting 'action'"),
    ("web --host 192.0.2.1", "192.0.2.1 is not an address of this computer"),
    ("compare --map nowhere", "nowhere"),
    ("compare --policies nearst", "unknown policy 'nearst'"),
    ("compare --policies nowhere.onnx", "nowhere.onnx: cannot be read"),
    ("compare --policies nearest run.zip", "run.zip: "),
    ("compare --preset perfect", "unknown preset 'perfect': choose one of arcade, ideal, robot"),
    ("compare --episodes 0", "must be at least 1"),
    ("compare --episodes 99999999999999999999", "must be at most 1000000000"),
    ("compare --episodes 1.5", "'1.5' is not a whole number"),
    ("compare --workers -1", "must be at least 0"),
    ("compare --seed -1", "must be at least 0"),
    ("compare --clyde-speed -0.1", "-0.1: must be at least 0"),
    ("compare --clyde-spawn-distance -1", "spawn_distance_m"),
    ("compare --spacing 2 --set pellets.spacing_m=2", "given twice"),
    ("compare --set clyde.speed_mps=1", "--clyde-speed"),
    ("compare --set randomize.clyde_speed_mps=0.1,0.2", "randomize.clyde_speed_mps = (0.1, 0.2): must be None"),
    ("compare --set nav2.haste=1", "unknown configuration field 'nav2.haste'"),
    ("compare --set action=velocity", "action = 'velocity': played by policies that name goals"),
    ("compare --set clyde.ghosts=policy", "clyde.ghosts[0] = 'policy': name the .onnx file that moves it"),
    ("compare --endless --set endless=true", "endless: given twice"),
    ("map generate houses --map house", "--map house: must be one of generated, generated:wide, generated:long"),
    ("compare --map generated:validation", "--map generated:validation: generated houses are generated,"),
    (f"compare --map house {MAPS}/house.yaml", "two maps are called house"),
    ("compare --map generated:test --num-levels 1001", "num_levels = 1001"),
    ("compare --map generated:test --start-level 5", "start_level = 5"),
    ("compare --start-level 0", "--start-level: is for --map generated"),
    ("compare --num-levels 3", "--num-levels: is for --map generated"),
    ("compare --video film.avi", "must end in .mp4 or .gif"),
    ("compare --plot plot.jpg", "must end in .png"),
    ("compare --json x.png", "must differ from --plot"),
    ("compare --parts room.yaml", "cannot create its folder"),
    ("compare --html page.htm", "--html page.htm: must end in .html"),
    ("compare --json x.html --html x.html", "must differ from --html"),
    ("compare --markdown league.md", "--markdown: must be combined with --suite"),
    ("compare --suite quick --plot x.png", "--plot: must not be combined with --suite"),
    ("compare --suite quick --markdown page.html", "--markdown page.html: must end in .md"),
    ("compare --suite quick --clyde-speed 0.3", "--clyde-speed: must not be combined with --suite"),
    ("compare --suite quick --map generated:test", "--suite has test levels"),
    ("compare --suite quick --endless", "endless: is set by --suite quick"),
    ("compare --suite quick --set clyde.ghosts=chase", "clyde.ghosts: is set by --suite quick"),
    ("compare --suite power --set power.pellets=2", "power.pellets: is set by --suite power"),
    ("compare --suites own.yaml", "--suites own.yaml: is for --suite"),
    ("compare --suite slow", "no suite 'slow': choose one of full, brief, learned, search, quick"),
    ("compare --suite quick --suites absent.yaml", "absent.yaml: cannot be read"),
    ("report", "pacman-env compare --html FILE"),
    ("leaderboard --suite quick", "pacman-env compare --suite NAME"),
    ("replay", "SEED"),
    ("replay -1", "must be at least 0"),
    ("replay 18446744073709551616", "must be at most"),
    ("replay 1 --out film.avi", "must end in one of .mp4, .gif, .html"),
    ("replay 1 --map house generated:test", "generated:test"),
    *(
        (f"dataset {name} --episodes 1", name)  # which Minari rejects
        for name in ("nothing", "../out-v0", "/out-v0", "a/b", "x/a-v0", "_/a-v0", "xx/a-v00", "xx/a-v\u0660")
    ),
    ("dataset data/a-v0 --episodes 1", "data/a-v0"),
    ("dataset xx/a-v0 --policy nobody", "unknown policy 'nobody'"),
    ("dataset xx/a-v0 --id PacManBot-v9", "--id PacManBot-v9: did you mean PacManBot-v2"),
    ("dataset xx/a-v0 --observation smell", "unknown observation kind 'smell'"),
    ("dataset xx/a-v0 --id PacManBotVelocity-v2", "action = 'velocity': must be goal"),
    ("export absent.zip --out mine.onnx", "absent.zip: no such file"),
]
#: Modules of the checkout that are commands.
MODULES = [
    ("benchmarks.coarse_model --map nowhere.yaml", "nowhere.yaml"),
    ("benchmarks.decision --policy nobody", "unknown policy 'nobody'"),
    ("benchmarks.decision --policy nearest --json .", "is a folder"),
    ("benchmarks.decision --policy search --parameter nodes", "--parameter nodes: must be NAME=VALUE"),
    ("benchmarks.decision --policy search --parameter colour=3", "colour"),
    ("benchmarks.decision --policy search --parameter nodes=3", "nodes = 3: must be at least"),
    ("benchmarks.versions .", "no checkout"),
    ("tests.system.memory walls", "part 'walls'"),
    ("tools.reference none.md", "none.md"),
    ("tools.validation --planner-answers room.yaml", "room.yaml"),
]
Refused = Callable[[Callable[[list[str]], int], list[str], str], None]


@pytest.mark.parametrize(("command", "message"), COMMANDS, ids=[command for command, _ in COMMANDS])
def test_command_refuses_wrong_arguments(command: str, message: str, tmp_path: Path, refused: Refused) -> None:
    words = command.split()
    if words[0] in NEEDED and find_spec(NEEDED[words[0]]) is None:
        pytest.skip(f"no {NEEDED[words[0]]}")
    pixels = np.full((42, 62), 254, np.uint8)
    room = OccupancyMap.from_pixels("room", pixels, 0.05, (-1.0, -1.0, 0.0)).save(tmp_path / "room.yaml")
    room.with_name("broken.yaml").write_text(room.read_text().replace("image:", "picture:"))
    refused(main, words, message)


@pytest.mark.parametrize(("command", "message"), MODULES, ids=[command for command, _ in MODULES])
def test_module_of_checkout_refuses_wrong_arguments(command: str, message: str, refused: Refused) -> None:
    module, *arguments = command.split()
    refused(import_module(module).main, arguments, message)
