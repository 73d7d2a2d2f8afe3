"""sb3-contrib's MaskablePPO, with more updates than by default: forbidden actions are never chosen."""

import sb3_contrib
import torch
from evaluate import parser, report, untrained

from pacman_env.sb3 import PacManBotVecEnv

args = parser(__doc__).parse_args()
torch.set_num_threads(1)  # a network this small is fastest on one core

env = PacManBotVecEnv(args.num_envs, flat=True, map=args.map)
hyperparameters = {"n_steps": 256, "gamma": 0.98, "ent_coef": 0.01}  # docs/use_with/sb3.md says why
model = sb3_contrib.MaskablePPO("MlpPolicy", env, **hyperparameters, seed=args.seed, verbose=1, device="cpu")
choose = lambda o, m: model.predict(o, action_masks=m, deterministic=True)[0]  # noqa: E731
untrained(choose, args.test, args.rounds)
model.learn(args.decisions)
if args.save:
    model.save(args.save)

report(choose, args.test, args.rounds, args.baselines)
