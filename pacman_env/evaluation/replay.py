"""Replay one round with several policies next to each other: ``pacman-env replay SEED``.

Writes a film, or a page with the film, and prints the outcomes and when and why each policy changed its goal. Games are
bit for bit equal to games of :func:`pacman_env.episodes.rollout.play` with the same seed.
"""

import argparse
import base64
import subprocess
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pacman_env.command_line.command import Parser, run_command, whole_number
from pacman_env.config import Config
from pacman_env.episodes.decisions import allowed, ghost_choices
from pacman_env.episodes.rollout import MOST_ROUNDS, open_games
from pacman_env.evaluation.rounds import scenarios
from pacman_env.evaluation.rounds.scenarios import Scenario
from pacman_env.evaluation.templates import render
from pacman_env.files import prepare, replaced, write_text
from pacman_env.game.decisions import HOLD as NO_GOAL
from pacman_env.game.decisions import LastDecision, Moment
from pacman_env.game.ends import ENDS, RUNNING
from pacman_env.game.goals import goal_name
from pacman_env.levels.level_source import LevelSource
from pacman_env.observations.situation import HOLD, PELLET, Situation
from pacman_env.observations.situation_writer import situation_of
from pacman_env.policies.base import KIND_NAMES
from pacman_env.policies.policy_calls import choose, reset
from pacman_env.render.frames import render_frame
from pacman_env.render.palette import THEMES, Theme

SPEED_UP = 4.0
_SUFFIXES = (".mp4", ".gif", ".html")
_LAST_FRAME_S = 1.5  # duration of the last frame, so that the end can be seen

Frame = NDArray[np.uint8]  # (height, W, 3) RGB


class Change(NamedTuple):
    when: str  # time since the start of the round, in an endless game with the round's number
    goal: str
    why: str
    film_s: float = 0.0  # time in the film, s


class RecordedGame:
    def __init__(self, source: LevelSource, config: Config, spec: str, seed: np.uint64, name: str) -> None:
        self.name, self.tick_s = name, config.execution.tick_s
        self.changes: list[Change] = []  # changes of the goal so far
        self._batch, self._ghosts = open_games(source, config)
        self._policy = scenarios.load_policy(spec)
        self._last = LastDecision(config)
        self._chosen = -1  # -1: no choice so far
        self._before_s = 0.0
        self._batch.reset(np.zeros(1, dtype=np.int64), np.array([seed], dtype=np.uint64))
        self._reset_policies()

    @property
    def over(self) -> bool:
        game = self._batch.games[0]
        return bool(game["end"] != RUNNING or game["round"] > MOST_ROUNDS)

    @property
    def level(self) -> int:
        """Return the number of the level; 0 if the scenario is a single map."""
        return int(self._batch.level_numbers()[0])

    def step(self) -> None:
        """Play one tick, with a decision if one is due; a game that is over stands still."""
        if self.over:
            return
        batch = self._batch
        moment = batch.moment(0)
        if self._last.due(moment):
            self._decide(moment)
        batch.step(np.array([self._chosen]), ghost_choices(batch, self._ghosts))
        if batch.games["tick_rounds"][0] > 0:
            self._before_s += moment.time_s + batch.config.execution.tick_s
            self._reset_policies()
            self._last.clear()
            self._chosen = -1

    def _reset_policies(self) -> None:
        """Reset the robot's policy and the ghosts' policies for a new round."""
        for policy in (self._policy, *self._ghosts.values()):
            reset(policy, np.ones(1, dtype=np.bool_), self._batch.config)

    def _decide(self, moment: Moment) -> None:
        batch = self._batch
        situation = situation_of(batch)
        terms = self._policy.explain(situation)[0]  # before the choice, which changes the policy's state
        selected = choose(self._policy, situation)
        choice = int(allowed(situation, selected, batch.hold)[0])
        if choice != self._chosen:
            why = _reason(situation, terms, choice, self._chosen, batch.alive[0])
            goal = self._goal_words(situation, choice)
            number = f"round {batch.games['round'][0]}, " if batch.config.endless else ""
            film_s = (self._before_s + situation.time_s[0]) / SPEED_UP
            self.changes.append(Change(f"{number}{situation.time_s[0]:.1f} s", goal, why, film_s))
        self._chosen = choice
        self._last.decide(NO_GOAL if choice == batch.hold else choice, moment, allowed=choice == selected[0])

    def _goal_words(self, situation: Situation, candidate: int) -> str:
        if candidate == self._batch.hold:
            return KIND_NAMES[HOLD]
        assets, slots = self._batch.assets_of(0), self._batch.pellet_slots
        goal = candidate if candidate < slots else assets.pellets + candidate - slots
        x, y = situation.position[0, candidate].tolist()
        return f"{goal_name(assets.pellet_ids.tolist(), goal)} at ({x:.2f}, {y:.2f})"

    def picture(self, height: int, theme: Theme = "light") -> Frame:
        return render_frame(self._batch, 0, height=height, title=self.name, theme=theme)

    def outcome(self) -> str:
        batch, game = self._batch, self._batch.games[0]
        seconds = self._before_s + game["step"] * batch.config.physics_step_s
        end, pellets = ENDS[game["end"]].name, f"{game['collected']} of {game['spawned']} pellets"
        if batch.config.endless:
            end, pellets = f"{end} in round {game['round']}", f"{game['all_collected']} pellets"
        lost = f", {game['lost']} lost" if game["lost"] and not batch.config.endless else ""
        caught = f", {game['all_caught']} ghosts caught" if batch.config.power.pellets > 0 else ""
        return f"{end} after {seconds:.1f} s, {pellets}{lost}{caught}"


def film(games: Sequence[RecordedGame], height: int, theme: Theme = "light") -> Iterator[Frame]:
    """Yield one frame per tick, ``height`` px high, with the games next to each other, until all have ended."""
    panels = [game.picture(height, theme) for game in games]
    yield np.hstack(panels)
    while not all(game.over for game in games):
        for k, game in enumerate(games):
            if not game.over:
                game.step()
                panels[k] = game.picture(height, theme)
        yield np.hstack(panels)


def record_games(
    scenario: Scenario, config: Config, policies: Mapping[str, str], seed: int | np.uint64
) -> list[RecordedGame]:
    """Return the same round for each policy; ``policies`` contains the name of each spec."""
    source = scenarios.open_scenario(scenario, config)
    return [RecordedGame(source, config, spec, np.uint64(seed), name) for spec, name in policies.items()]


def first_frame(games: Sequence[RecordedGame], height: int = 480, theme: Theme = "light") -> bytes:
    """Return a PNG of the games in their present state, for example as the poster of a film that follows."""
    import imageio.v3 as imageio

    frame = np.hstack([game.picture(height, theme) for game in games])
    return bytes(imageio.imwrite("<bytes>", frame, extension=".png"))


def film_games(games: Sequence[RecordedGame], path: Path, height: int = 480, theme: Theme = "light") -> None:
    save_video(film(games, height, theme), path, games[0].tick_s)


def save_video(frames: Iterator[Frame], path: Path, tick_s: float) -> None:
    """Write frames as .mp4 or .gif; a frame shows ``tick_s`` of the game, and the film is ``SPEED_UP`` times as fast.

    Height and width of the frames should be even.
    """
    import imageio.v2 as imageio

    fps = SPEED_UP / tick_s
    with replaced(path) as temporary:
        if path.suffix.lower() == ".gif":
            writer = imageio.get_writer(temporary, mode="I", duration=1000 / fps, loop=0)
        else:
            writer = imageio.get_writer(temporary, fps=fps, codec="libx264", macro_block_size=2)
        cut = f"{path}: ffmpeg has not written the whole film (is the disk full?)"
        try:
            with writer:
                for frame in frames:
                    writer.append_data(frame)
                for _ in range(round(_LAST_FRAME_S * fps)):
                    writer.append_data(frame)
        except OSError as error:
            if error.errno is not None:
                raise
            raise OSError(cut) from error  # imageio's message is ffmpeg's whole command
        if path.suffix.lower() != ".gif" and not _can_be_read(temporary):
            raise OSError(cut)


def _can_be_read(film: Path) -> bool:
    """Return True if ffmpeg can read the whole film; needed because the writer ignores ffmpeg's exit status."""
    from imageio_ffmpeg import get_ffmpeg_exe

    read = [get_ffmpeg_exe(), "-v", "error", "-i", str(film), "-c", "copy", "-f", "null", "-"]
    return subprocess.run(read, stdin=subprocess.DEVNULL, capture_output=True).returncode == 0


def _reason(
    situation: Situation, terms: list[dict[str, Any]], choice: int, before: int, alive: NDArray[np.bool_]
) -> str:
    """Explain by the policy's terms why the candidate ``choice`` replaced the candidate ``before`` (-1: none)."""
    mask = situation.mask[0]
    reasons = []
    other, called = -1, ""
    if before >= 0 and mask[before]:
        other, called = before, "the previous goal"
    elif before >= 0:
        pellet = situation.kind[0, before] == PELLET
        reasons.append(f"the previous goal is {'gone' if pellet and not alive[before] else 'not allowed'}")
    if other < 0:
        scores = [float(t.get("score", -np.inf)) if mask[c] and c != choice else -np.inf for c, t in enumerate(terms)]
        best = int(np.argmax(scores))
        if scores[best] > -np.inf:
            other, called = best, "the next best"
    score = f"score {_value(terms[choice].get('score', '-'))}"
    if other >= 0:
        score += f" against {_value(terms[other].get('score', '-'))} of {called}"
    reasons.append(score)
    reasons += [
        name if value is True else f"{name} {_value(value)}"
        for name, value in terms[choice].items()
        if name not in ("kind", "allowed", "score") and value is not False
    ]
    return ", ".join(reasons)


def _value(value: Any) -> str:
    return f"{value:.2f}" if isinstance(value, float) else str(value)


def main(argv: Sequence[str] | None = None) -> int:
    return run_command(make_parser(), argv, _replay)


def make_parser() -> Parser:
    parser = Parser(
        prog="pacman-env replay",
        description="Play one round of a comparison again with each policy and film it. Give the arguments of the"
        " comparison: map or levels, speed of Clyde, and all settings.",
    )
    seed_help = "seed of the round, from 'seeds' in the JSON file of the comparison"
    parser.add_argument("seed", type=whole_number(0, 2**64 - 1), metavar="SEED", help=seed_help)
    scenarios.add_policy_arguments(parser, ("clyde_aware", "nearest"), "policies from left to right")
    scenarios.add_game_arguments(parser, several=False)
    out_help = f"file to write: {', '.join(_SUFFIXES)} (results/replay-SEED.mp4)"
    parser.add_argument("--out", type=Path, metavar="FILE", help=out_help)
    parser.add_argument("--theme", choices=THEMES, default="light", help="colours of the film (%(default)s)")
    return parser


def _replay(arguments: argparse.Namespace) -> None:
    config = scenarios.game_configs(arguments)[0]
    policies = scenarios.named_policies(scenarios.distinct("--policies", arguments.policies))
    wanted = scenarios.from_arguments(arguments)
    if len(wanted) > 1:
        raise ValueError("--map: a round is played on one map")
    place = scenarios.scenario_name(wanted[0], config)
    out = arguments.out or Path(f"results/replay-{arguments.seed}.mp4")
    if out.suffix.lower() not in _SUFFIXES:
        raise ValueError(f"--out {out}: must end in one of {', '.join(_SUFFIXES)}")
    prepare(out)
    games = record_games(wanted[0], config, policies, arguments.seed)
    level = f", level {games[0].level}" if isinstance(wanted[0], scenarios.Levels) else ""
    speed = f"Clyde at {config.clyde.speed_mps:g} m/s"
    title = f"Round {arguments.seed} on {place}{level}, {speed}"
    _write(out, games, title, arguments.theme)
    print(title)
    for game in games:
        print(f"\n{game.name}: {game.outcome()}")
        for change in game.changes:
            print(f"  {change.when:>8}  {change.goal}: {change.why}")
    print(f"\nwritten: {out}")


def _write(out: Path, games: Sequence[RecordedGame], title: str, theme: Theme) -> None:
    if out.suffix.lower() != ".html":
        film_games(games, out, theme=theme)
        return
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "film.mp4"
        poster = base64.b64encode(first_frame(games, theme=theme)).decode()
        film_games(games, path, theme=theme)
        video = base64.b64encode(path.read_bytes()).decode()
    text = render("replay.html.j2", title=title, video=video, poster=poster, games=games)
    write_text(out, text)
