"""Write prepared maps for the browser: the memory that kernels need, and the facts that the page shows."""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from pacman_env.engine.arrays import Table
from pacman_env.game.ends import ENDS
from pacman_env.levels.level import COARSE_MAP, PREDICTION, Level
from pacman_env.observations import planner_features
from pacman_env.observations.planner_columns import CANDIDATE_FEATURES, GLOBAL_FEATURES
from pacman_env.observations.situation_writer import new_situation, situation_stage
from pacman_env.policies.learned import _SHOWN, LearnedPlanner
from pacman_env.sim.ghost_state import BEHAVIOUR_NAMES
from pacman_env.sim.parameters import draw_episodes
from pacman_env.web.played_round import PlayedRound
from pacman_env.web.rules import PLAY, Choices, Rules
from pacman_env.web.simulated_view import scene_of
from pacman_env.world.navigation import physics
from tools.browser_game.image import Image, flat, save
from tools.browser_game.kernels import PlannerArrays, StartArrays

MOST_GHOSTS = 4


class Prepared(NamedTuple):
    """A round before its first tick, with a table for each kernel of the browser."""

    played: PlayedRound
    tables: dict[str, Table]
    rules: Rules


def prepare(map: str, level: int | None, ghosts: int, planner: LearnedPlanner) -> Prepared:
    """Prepare a round as *Play* of the page sets it up, with ``ghosts`` ghosts of every behaviour."""
    rules = Rules(map, level, PLAY["preset"], ghosts=("wander",) * ghosts, settings=PLAY["settings"])
    played = PlayedRound(*Choices().prepare(rules, PLAY["clyde_mps"]), (planner.name,), 0)
    batch = played.batch
    batch.compile_behaviours(range(len(BEHAVIOUR_NAMES)))
    situation = new_situation(batch)
    slots = situation.mask.shape[1]
    features = {
        "candidates": np.zeros((1, slots, len(CANDIDATE_FEATURES)), np.float32),
        "whole": np.zeros((1, len(GLOBAL_FEATURES)), np.float32),
    }
    speed = planner.metadata.robot_speed_mps
    fresh = draw_episodes(np.zeros(1, np.uint64), played.config)
    batch._levels.enter(np.zeros(1, np.int64), fresh)
    state = batch._ghosts
    start = Table(
        StartArrays,
        rules=batch.rule_arrays,
        ghosts=state.state,
        paths=state.paths,
        fresh=fresh,
        seeds=np.zeros(1, np.uint64),
        wander_first=state.wander_first,
    )
    judged = {"mask": situation.mask, "logits": np.zeros(slots), "value": np.zeros(1)}
    tables = {
        "begin_rounds": start,
        "place_ghost": start,
        "play": batch.tick_stage()[1][0],
        "write_situations": situation_stage(batch, situation)[1][0],
        "fill": planner_features.planner_stage(situation, speed, situation.mask, **features)[1][0],
        "judge": Table(PlannerArrays, **judged, **features, network=planner._session._network),
        "situation": situation.table,
    }
    return Prepared(played, tables, rules)


def write(map: str, level: int | None, planner: LearnedPlanner, network: Image, path: Path) -> None:
    """Write a map: its memory, the memory of a round for each number of ghosts, all at one place, and its facts."""
    rounds = [prepare(map, level, ghosts, planner) for ghosts in range(1, MOST_GHOSTS + 1)]
    shown = _level(rounds[0])
    own = Image(network.end, network.functions, network)
    own.add_tables([shown.table])
    entries, stored = own.packed()
    scene = scene_of(rounds[0].played, rounds[0].rules, 1)
    facts = _facts(rounds[0].played) | {"scene": scene.facts | {"second": None}}
    header: dict[str, Any] = {"facts": facts, "entries": entries, "end": own.end, "rounds": []}
    records: dict[np.dtype[Any], str] = {}
    for one in rounds:
        image = _round(one, own, shown)
        parts, more = image.packed()
        stored += more
        tables = {name: _table(table, image, records) for name, table in _tables(one).items()}
        header["rounds"].append({"end": image.end, "entries": parts, "tables": tables})
    path.with_suffix(".png").write_bytes(scene.picture)
    save(path, {**header, "records": {name: _record(dtype) for dtype, name in records.items()}}, stored)


def _facts(played: PlayedRound) -> dict[str, Any]:
    """Return what the page needs to know of a map and of the rules of its rounds, besides its scene."""
    config = played.config
    return {
        "pellets": played.assets.pellets,
        "numbers": played._numbers.tolist(),
        "candidates": played.assets.goal_xy.tolist(),
        "power": np.flatnonzero(played.power_pellets).tolist(),
        "behaviours": BEHAVIOUR_NAMES,
        "ends": [end.word for end in ENDS],
        "columns": len(CANDIDATE_FEATURES),
        "terms": {name: CANDIDATE_FEATURES.index(name) for name in _SHOWN},
        "cells": len(played.assets.clyde.position),
        "hash": played.assets.occupancy.hash,
        "configuration": config.hash,
        "return_s": config.power.return_s,
        "ghost_points": config.power.ghost_points,
        "physics_step_s": config.physics_step_s,
        "tick_s": config.execution.tick_s,
        "body": {
            "radius_m": config.robot.radius_m,
            "mass_kg": config.robot.mass_kg,
            "slop_m": physics._COLLISION_SLOP_M,
        },
    }


def _level(prepared: Prepared) -> Level:
    batch = prepared.played.batch
    return batch.levels.level(int(batch.games["level"][0]))


def _round(prepared: Prepared, before: Image, shown: Level) -> Image:
    """Return the image of the memory of a round, which lies after the image ``before`` of the map ``shown``."""
    batch, level = prepared.played.batch, _level(prepared)
    image = Image(before.end, before.functions, before)
    for mine, copied in zip(_level_tables(level), _level_tables(shown), strict=True):
        image.equate(mine, copied)
    image.add(*batch._ghosts._constants, *planner_features._outlooks[batch.levels]._believed._constants)
    image.add_tables(prepared.tables.values())
    return image


def _level_tables(level: Level) -> list[Table]:
    return [level.table, *(table for place in (PREDICTION, COARSE_MAP) if (table := level.find(place)))]


def _tables(prepared: Prepared) -> dict[str, Table]:
    """Return the tables whose arrays the page reads and writes, by name."""
    ghosts, contacts = prepared.played.batch._kept[0]
    return {**prepared.tables, "ghosts": ghosts, "contacts": contacts._table, "level": _level(prepared).table}


def _table(table: Table, image: Image, records: dict[np.dtype[Any], str]) -> dict[str, Any]:
    """Return the address of a table, and address, type and shape of its arrays; types of records get names."""

    def kind(dtype: np.dtype[Any]) -> str:
        return records.setdefault(dtype, f"record{len(records)}") if dtype.fields else dtype.str[1:]

    arrays = {
        name: (image.place(one), kind(one.dtype), one.shape) for name, one in flat(table.arrays).items() if one.size
    }
    return {"at": image.place(table.numbers), "arrays": arrays}


def _record(dtype: np.dtype[Any]) -> dict[str, Any]:
    """Return the size of a record, and offset and type of its fields."""
    fields = {name: (place[1], place[0].base.str[1:]) for name, place in (dtype.fields or {}).items()}
    return {"size": dtype.itemsize, "fields": fields}
