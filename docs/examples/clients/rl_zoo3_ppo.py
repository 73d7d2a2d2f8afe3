"""RL Baselines3 Zoo: its command trains Stable-Baselines3's PPO by the environment's id, and writes its folder of logs.

The zoo has no hyperparameters for this environment: this script writes a file with them. It knows no masks, a forbidden
action makes the robot hold.
"""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import stable_baselines3
import torch
import yaml
from evaluate import parser, report, untrained

import pacman_env  # noqa: F401 - registers the environments

ENV_ID = "pacman_env/PacManBotFlat-v2"

args = parser(__doc__).parse_args()
torch.set_num_threads(1)  # a network this small is fastest on one core

model = stable_baselines3.PPO("MlpPolicy", ENV_ID, seed=args.seed, device="cpu")
choose = lambda o, m: model.predict(o, deterministic=True)[0]  # noqa: E731
untrained(choose, args.test, args.rounds)

with tempfile.TemporaryDirectory() as folder:
    hyperparameters = Path(folder, "ppo.yml")
    wanted = {"n_envs": args.num_envs, "n_timesteps": args.decisions, "policy": "MlpPolicy"}
    hyperparameters.write_text(yaml.safe_dump({ENV_ID: wanted}))
    command = [sys.executable, "-m", "rl_zoo3.train", "--algo", "ppo", "--env", ENV_ID]
    command += ["--gym-packages", "pacman_env"]  # imported first: it registers the ids
    command += ["--env-kwargs", f"map:{args.map!r}"]
    command += ["--conf-file", str(hyperparameters), "--seed", str(args.seed), "--device", "cpu"]
    command += ["--eval-freq", "-1", "--log-folder", folder]  # the zoo would evaluate during training
    subprocess.run(command, check=True, env={**os.environ, "OMP_NUM_THREADS": "1"})
    (saved,) = Path(folder, "ppo").glob("*/*PacManBotFlat-v2.zip")
    model = stable_baselines3.PPO.load(saved, device="cpu")

if args.save:
    model.save(args.save)

report(choose, args.test, args.rounds, args.baselines)
