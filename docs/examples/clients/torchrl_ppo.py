"""TorchRL's PPO with the numbers of its tutorial; actions are drawn from a MaskedCategorical."""

import gymnasium as gym
import numpy as np
import torch
from evaluate import parser, report, untrained
from gymnasium.vector import AutoresetMode
from tensordict import TensorDict
from tensordict.nn import TensorDictModule
from torch import nn
from torchrl.collectors import Collector
from torchrl.data import LazyTensorStorage, ReplayBuffer, SamplerWithoutReplacement
from torchrl.envs import Compose, DTypeCastTransform, ExplorationType, GymWrapper, RewardSum, TransformedEnv
from torchrl.envs.utils import set_exploration_type
from torchrl.modules import MaskedCategorical, ProbabilisticActor, ValueOperator
from torchrl.objectives import ClipPPOLoss
from torchrl.objectives.value import GAE

import pacman_env  # noqa: F401 - registers the environments

NUM_CELLS = 256
LEARNING_RATE = 3e-4
MAX_GRAD_NORM = 1.0
FRAMES_PER_BATCH = 1000
SUB_BATCH_SIZE = 64
NUM_EPOCHS = 10
CLIP_EPSILON = 0.2
GAMMA = 0.99
LMBDA = 0.95
ENTROPY_COEFF = 1e-4


def network(inputs: int, outputs: int) -> nn.Sequential:
    """Three hidden layers."""
    cells = NUM_CELLS
    hidden = (nn.Linear(inputs, cells), nn.Tanh(), nn.Linear(cells, cells), nn.Tanh(), nn.Linear(cells, cells))
    return nn.Sequential(*hidden, nn.Tanh(), nn.Linear(cells, outputs))


args = parser(__doc__).parse_args()
torch.set_num_threads(1)  # a network this small is fastest on one core
torch.manual_seed(args.seed)

games = gym.make_vec(
    "pacman_env/PacManBotFlat-v2",
    num_envs=args.num_envs,
    vectorization_mode="vector_entry_point",
    autoreset_mode=AutoresetMode.DISABLED,  # TorchRL asks for resets itself
    map=args.map,
    settings={"observation.mask": "beside"},
)
to_bool = DTypeCastTransform(torch.int8, torch.bool, in_keys=["action_mask"])  # as MaskedCategorical takes it
env = TransformedEnv(GymWrapper(games, categorical_action_encoding=True), Compose(to_bool, RewardSum()))
env.set_seed(args.seed)

inputs, actions = games.single_observation_space["observation"].shape[0], int(games.single_action_space.n)
actor = ProbabilisticActor(
    TensorDictModule(network(inputs, actions), in_keys=["observation"], out_keys=["logits"]),
    in_keys={"logits": "logits", "mask": "action_mask"},
    out_keys=["action"],
    distribution_class=MaskedCategorical,
    return_log_prob=True,
)


@torch.no_grad()
def choose(observation: np.ndarray, allowed: np.ndarray) -> np.ndarray:
    """Return the likeliest actions."""
    seen = {"observation": torch.from_numpy(observation), "action_mask": torch.from_numpy(allowed)}
    with set_exploration_type(ExplorationType.MODE):
        return actor(TensorDict(seen, batch_size=len(observation)))["action"].numpy()


untrained(choose, args.test, args.rounds)
critic = ValueOperator(network(inputs, 1), in_keys=["observation"])
advantage = GAE(gamma=GAMMA, lmbda=LMBDA, value_network=critic, average_gae=True)
loss_module = ClipPPOLoss(actor, critic, clip_epsilon=CLIP_EPSILON, entropy_coeff=ENTROPY_COEFF, critic_coeff=1.0)
optimizer = torch.optim.Adam(loss_module.parameters(), LEARNING_RATE)
batches = max(args.decisions // FRAMES_PER_BATCH, 1)
scheduler = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, batches)
collector = Collector(
    env,
    actor,
    frames_per_batch=FRAMES_PER_BATCH,
    total_frames=batches * FRAMES_PER_BATCH,
    auto_register_policy_transforms=False,  # they are for recurrent networks
)
buffer = ReplayBuffer(storage=LazyTensorStorage(FRAMES_PER_BATCH), sampler=SamplerWithoutReplacement())

for number, batch in enumerate(collector, start=1):
    for _ in range(NUM_EPOCHS):
        advantage(batch)
        buffer.extend(batch.reshape(-1))
        for _ in range(FRAMES_PER_BATCH // SUB_BATCH_SIZE):
            loss = loss_module(buffer.sample(SUB_BATCH_SIZE))
            (loss["loss_objective"] + loss["loss_critic"] + loss["loss_entropy"]).backward()
            nn.utils.clip_grad_norm_(loss_module.parameters(), MAX_GRAD_NORM)
            optimizer.step()
            optimizer.zero_grad()
    scheduler.step()
    ended = batch["next", "done"]
    if number % max(batches // 20, 1) == 0 and ended.any():
        returns = batch["next", "episode_reward"][ended]
        print(f"{number * FRAMES_PER_BATCH} decisions: return {returns.mean().item():.2f}", flush=True)
collector.shutdown()

if args.save:
    torch.save(actor.state_dict(), args.save)

report(choose, args.test, args.rounds, args.baselines)
