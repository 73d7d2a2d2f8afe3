"""Examples of all commands, shown in their help, and first steps, shown by ``pacman-env`` without a command."""

from pacman_env.files import install_command

PROG = "pacman-env"
_ROOM = 50  # longest example, in characters, on one line with its purpose
Example = tuple[str, str]  # arguments of ``pacman-env``, and their purpose

#: First steps: arguments, purpose and the required extra.
FIRST: tuple[tuple[str, str, str], ...] = (
    ("compare --episodes 20", "compare policies on the same 20 rounds: table and plot", "eval"),
    ("web --open", "watch or play a game in the browser", "web"),
    ("map check home.yaml", "check whether your own map can be played", ""),
    ("train --quick", "train a planner in one to two minutes", "train"),
)

#: Examples by command; subcommands with their group.
EXAMPLES: dict[str, tuple[Example, ...]] = {
    "map check": (
        ("map check home.yaml", "check your own map"),
        ("map check home.yaml --set pellets.free_grey=242", "check a map from Cartographer, whose free cells are grey"),
        ("map check house --spacing 1.5 --json", "check a shipped map with more pellets; print JSON"),
    ),
    "map turn": (("map turn home.yaml turned.yaml", "write a map whose origin has a yaw with yaw 0"),),
    "map list": (("map list", "list the shipped maps"),),
    "map generate": (("map generate results/houses --level 7 --count 3", "write the houses of levels 7 to 9"),),
    "web": (
        ("web --open", "show a simulated game in the browser"),
        ("web --ros --host 0.0.0.0", "show the game on a robot, also to phones"),
    ),
    "warm-up": (("warm-up", "compile before the first use, about half a minute"),),
    "compare": (
        ("compare --episodes 20", "compare the default policies on the map house"),
        ("compare --map generated:test --set clyde.ghosts=arcade,chase", "use generated houses and other ghosts"),
        ("compare --policies clyde_aware mine.onnx --json results/numbers.json", "compare your own policy; write JSON"),
        ("compare --map house maze --html results/maps.html", "write a page about two maps"),
        ("compare --suite quick --policies ppo nearest --workers 2", "print a small league table"),
    ),
    "dataset": (
        ("dataset pacman-env/house-v0 --policy lookahead --episodes 100", "record 100 rounds"),
        ("dataset pacman-env/levels-v0 --map generated --set num_levels=200", "use generated houses"),
    ),
    "replay": (
        (
            "replay 16452687389592421897 --map house --policies clyde_aware lookahead",
            "replay a round of a comparison by its seed",
        ),
    ),
    "train": (
        ("train --quick", "check in one to two minutes that training works"),
        ("train --seed 0 --out results/ppo", "run the whole training; add --resume to continue it"),
    ),
    "export": (("export results/ppo/last.zip --out mine.onnx", "export the last checkpoint of a training"),),
    "ros up": (
        ("ros up --map house --sim --speed 4 --start", "play a whole game without a robot"),
        ("ros up --map home.yaml --namespace robot_15", "play on the robot"),
    ),
    "ros start": (("ros start --namespace robot_15", "start the next round"),),
    "ros reset": (("ros reset --sim", "reset a simulated game"),),
    "ros continue": (("ros continue --sim", "continue a simulated game"),),
    "ros stop": (("ros stop --namespace robot_15", "stop the robot"),),
    "ros release": (("ros release --namespace robot_15", "let the robot drive again"),),
    "ros status": (("ros status --sim --json", "print the status of a simulated game as JSON"),),
    "ros doctor": (("ros doctor --map home.yaml --namespace robot_15", "check the robot before a game"),),
    "ros goal_selector": (("ros goal_selector --map home.yaml --policy nearest", "play in the original's game"),),
    "ros record": (("ros record --out games/first", "record until Ctrl-C"),),
    "ros replay": (("ros replay games/first --map home.yaml --policy nearest", "show what nearest would have done"),),
}


def examples_of(command: str) -> list[Example]:
    """Return the examples of a command, or of all commands of a group; [] for unknown commands."""
    return [
        example
        for name, examples in EXAMPLES.items()
        if name == command or name.startswith(f"{command} ")
        for example in (examples if name == command else examples[:1])
    ]


def render(examples: list[Example]) -> str:
    """Return one line per example with its purpose, which goes to a second line if the example is long."""
    width = max((len(words) for words, _ in examples if len(words) <= _ROOM), default=0)
    return "\n".join(
        f"  {PROG} {words:<{width}}  {purpose}" if len(words) <= _ROOM else f"  {PROG} {words}\n      {purpose}"
        for words, purpose in examples
    )


def first_steps(version: str) -> str:
    """Return the text of ``pacman-env`` without a command."""
    shown = [(words, f"{purpose} [{extra}]" if extra else purpose) for words, purpose, extra in FIRST]
    return (
        f"pacman_env {version}: a robot plays Pac-Man on drawn, generated or your own maps. For example:\n\n"
        f"{render(shown)}\n\n"
        f"Brackets show the extra that a command needs: {install_command('eval')}.\n"
        "All commands: pacman-env --help. Arguments and examples of a command: pacman-env COMMAND --help."
    )
