"""Stable-Baselines3's PPO with its own defaults: it knows no masks, a forbidden action makes the robot hold."""

import stable_baselines3
import torch
from evaluate import parser, report, untrained

from pacman_env.sb3 import PacManBotVecEnv

args = parser(__doc__).parse_args()
torch.set_num_threads(1)  # a network this small is fastest on one core

env = PacManBotVecEnv(args.num_envs, flat=True, map=args.map)
model = stable_baselines3.PPO("MlpPolicy", env, seed=args.seed, verbose=1, device="cpu")
choose = lambda o, m: model.predict(o, deterministic=True)[0]  # noqa: E731
untrained(choose, args.test, args.rounds)
model.learn(args.decisions)
if args.save:
    model.save(args.save)

report(choose, args.test, args.rounds, args.baselines)
