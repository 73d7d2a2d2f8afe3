"""Examples of all commands, shown in their help, and first steps, shown by ``pacman-env`` without a command."""

import textwrap

from pacman_env.files import install_command

PROG = "pacman-env"
_ROOM = 50  # characters
Example = tuple[str, str]  # arguments of ``pacman-env``, and their purpose

#: First steps: arguments, purpose and the required extra.
FIRST: tuple[tuple[str, str, str], ...] = (
    ("compare --episodes 20", "policies on the same 20 rounds: a table and a plot", "eval"),
    ("web --open", "see a game in the browser, and play it", "web"),
    ("play --map maze", "play in a window", "render"),
    ("map check home.yaml", "whether your own map can be played", ""),
    ("train --quick", "train a planner, one to two minutes", "train"),
)

#: Examples by command; subcommands with their group.
EXAMPLES: dict[str, tuple[Example, ...]] = {
    "map check": (
        ("map check home.yaml", "your own map"),
        ("map check home.yaml --set pellets.free_grey=242", "a map of Cartographer, whose free cells are grey"),
        ("map check house --spacing 1.5 --json", "a shipped map with more pellets, as JSON"),
    ),
    "map list": (("map list", "the shipped maps"),),
    "map generate": (("map generate results/houses --level 7 --count 3", "the houses of levels 7 to 9"),),
    "play": (
        ("play", "a round on the map house"),
        ("play --map generated --clyde-speed 0.4 --drive", "drive in a new house each round, Clyde faster"),
    ),
    "web": (
        ("web --open", "a simulated game, in this machine's browser"),
        ("web --ros --host 0.0.0.0", "the robot's game, also for telephones"),
    ),
    "warm-up": (("warm-up", "before the first use, about half a minute"),),
    "completion": (("completion bash", "the script for bash, to be stored where bash looks for it"),),
    "compare": (
        ("compare --episodes 20", "all rules and the planner on the map house"),
        ("compare --policies ppo lookahead --levels test --set clyde.ghosts=arcade,chase", "in houses, two ghosts"),
        ("compare --policies clyde_aware mine.onnx --json results/numbers.json", "your own policy, figures as JSON"),
    ),
    "report": (
        ("report --quick --out results/quick.html", "a page in some minutes"),
        ("report --map house maze --levels test --workers 2", "several maps, two processes"),
    ),
    "leaderboard": (("leaderboard --suite quick --workers 2", "a small league table"),),
    "dataset": (
        ("dataset pacman-env/house-v0 --policy lookahead --episodes 100", "100 rounds, for Minari and as Parquet"),
        ("dataset pacman-env/levels-v0 --map generated --set num_levels=200 --format parquet", "in generated houses"),
        ("dataset pacman-env/my-robot-v0 --bags games/first --map home.yaml", "what a robot has played"),
    ),
    "bound": (("bound --map house --starts 30 --width 32", "on one map, the ghosts of the defaults"),),
    "replay": (
        (
            "replay 16452687389592421897 --map house --policies clyde_aware lookahead",
            "a round of a comparison again, by its seed",
        ),
    ),
    "benchmark": (("benchmark --json results/benchmark.json", "all figures, also as JSON"),),
    "validation": (("validation --map house --episodes 100", "a table in about a minute"),),
    "houses": (("houses --levels 100", "50 houses to train in, 50 to be tested in"),),
    "train": (
        ("train --quick", "one to two minutes, to see that it works"),
        ("train --seed 0 --out results/ppo", "the whole training; --resume goes on with it"),
    ),
    "seeds": (("seeds --quick --seeds 0 1 2 --workers 2", "three short trainings, two at a time; a table"),),
    "tune": (("tune --trials 30 --out results/tune", "30 short trainings; the best file is named at the end"),),
    "adversary": (("adversary --quick", "about two minutes, to see that it works"),),
    "learning-curves": (("learning-curves --combinations planner/event --seeds 0 1 2", "one kind, three seeds"),),
    "export": (("export results/ppo/last.zip --out mine.onnx", "the last checkpoint of a training"),),
    "ros up": (
        ("ros up --map house --sim --speed 4 --start", "a whole game without a robot"),
        ("ros up --map home.yaml --namespace robot_15", "the robot's game"),
    ),
    "ros start": (("ros start --namespace robot_15", "the next round"),),
    "ros reset": (("ros reset --sim", "of a simulated game"),),
    "ros continue": (("ros continue --sim", "of a simulated game"),),
    "ros stop": (("ros stop --namespace robot_15", "the robot stands"),),
    "ros release": (("ros release --namespace robot_15", "it may drive again"),),
    "ros status": (("ros status --sim --json", "of a simulated game, as JSON"),),
    "ros doctor": (("ros doctor --map home.yaml --namespace robot_15", "before a game"),),
    "ros record": (("ros record --out games/first", "until Ctrl-C"),),
    "ros replay": (("ros replay games/first --map home.yaml --policy nearest", "what nearest would have done"),),
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
    return textwrap.dedent("""\
        pacman_env {version}: a robot plays Pac-Man on real SLAM maps. For example:

        {examples}

        In brackets is the extra that a command needs: {install}.
        All commands: pacman-env --help; the arguments and examples of one: pacman-env COMMAND --help.""").format(
        version=version, examples=render(shown), install=install_command("eval")
    )
