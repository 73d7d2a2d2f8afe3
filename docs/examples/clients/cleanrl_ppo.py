"""PPO in one file after CleanRL's ppo.py, with its defaults; a mask on the logits is all that was added."""

import gymnasium as gym
import numpy as np
import torch
from evaluate import parser, report, untrained
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers.vector import RecordEpisodeStatistics
from torch import nn
from torch.distributions import Categorical

import pacman_env  # noqa: F401 - registers the environments

LEARNING_RATE = 2.5e-4
NUM_STEPS = 128
GAMMA = 0.99
GAE_LAMBDA = 0.95
NUM_MINIBATCHES = 4
UPDATE_EPOCHS = 4
CLIP_COEF = 0.2
ENT_COEF = 0.01
VF_COEF = 0.5
MAX_GRAD_NORM = 0.5


def layer_init(layer: nn.Linear, std: float = np.sqrt(2)) -> nn.Linear:
    """Orthogonal weights, biases 0."""
    nn.init.orthogonal_(layer.weight, std)
    nn.init.constant_(layer.bias, 0.0)
    return layer


class Agent(nn.Module):
    """Two networks, of the actions and of the value."""

    def __init__(self, envs: gym.vector.VectorEnv) -> None:
        super().__init__()
        inputs, actions = envs.single_observation_space.shape[0], envs.single_action_space.n
        self.critic = nn.Sequential(
            *(layer_init(nn.Linear(inputs, 64)), nn.Tanh(), layer_init(nn.Linear(64, 64)), nn.Tanh()),
            layer_init(nn.Linear(64, 1), std=1.0),
        )
        self.actor = nn.Sequential(
            *(layer_init(nn.Linear(inputs, 64)), nn.Tanh(), layer_init(nn.Linear(64, 64)), nn.Tanh()),
            layer_init(nn.Linear(64, actions), std=0.01),
        )

    def policy(self, obs: torch.Tensor, mask: torch.Tensor) -> Categorical:
        """Of observations (N, D), float32, and masks (N, A), bool; what is forbidden has probability 0."""
        return Categorical(logits=self.actor(obs).masked_fill(~mask, -1e8))


args = parser(__doc__, num_envs=4).parse_args()
torch.set_num_threads(1)  # a network this small is fastest on one core
torch.manual_seed(args.seed)
rng = np.random.default_rng(args.seed)

# As CleanRL's loop expects it, the observation after an end is the first of the next round. Without SAME_STEP, a step
# after each end would do nothing but reset, and be learned from.
envs = gym.make_vec(
    "pacman_env/PacManBotFlat-v2",
    num_envs=args.num_envs,
    vectorization_mode="vector_entry_point",
    autoreset_mode=AutoresetMode.SAME_STEP,
    map=args.map,
)
games = envs.unwrapped  # which knows the masks
envs = RecordEpisodeStatistics(envs)

agent = Agent(envs)


@torch.no_grad()
def choose(observation: np.ndarray, allowed: np.ndarray) -> np.ndarray:
    """Return the likeliest actions."""
    logits = agent.policy(torch.from_numpy(observation), torch.from_numpy(allowed)).logits
    return logits.argmax(dim=1).numpy()


untrained(choose, args.test, args.rounds)
optimizer = torch.optim.Adam(agent.parameters(), lr=LEARNING_RATE, eps=1e-5)
batch_size = args.num_envs * NUM_STEPS
shape = (NUM_STEPS, args.num_envs)
obs = torch.zeros(shape + envs.single_observation_space.shape)
masks = torch.zeros((*shape, int(envs.single_action_space.n)), dtype=torch.bool)
actions = torch.zeros(shape, dtype=torch.int64)
logprobs, rewards, dones, values = (torch.zeros(shape) for _ in range(4))

first, _ = envs.reset(seed=args.seed)
next_obs, next_mask = torch.from_numpy(first), torch.from_numpy(games.action_masks())
next_done = torch.zeros(args.num_envs)
num_iterations = max(args.decisions // batch_size, 1)
for iteration in range(num_iterations):
    optimizer.param_groups[0]["lr"] = (1.0 - iteration / num_iterations) * LEARNING_RATE

    for step in range(NUM_STEPS):
        obs[step], masks[step], dones[step] = next_obs, next_mask, next_done
        with torch.no_grad():
            policy = agent.policy(next_obs, next_mask)
            actions[step] = policy.sample()
            logprobs[step] = policy.log_prob(actions[step])
            values[step] = agent.critic(next_obs).flatten()
        seen, reward, terminations, truncations, _ = envs.step(actions[step].numpy())
        # PacManBotFlat terminates at its time limit, so no value is to be added to a last reward.
        next_done = torch.from_numpy(terminations | truncations).float()
        rewards[step] = torch.from_numpy(reward)
        next_obs, next_mask = torch.from_numpy(seen), torch.from_numpy(games.action_masks())

    with torch.no_grad():
        advantages = torch.zeros(shape)
        last = torch.zeros(args.num_envs)
        next_value, alive = agent.critic(next_obs).flatten(), 1.0 - next_done
        for t in reversed(range(NUM_STEPS)):
            delta = rewards[t] + GAMMA * next_value * alive - values[t]
            advantages[t] = last = delta + GAMMA * GAE_LAMBDA * alive * last
            next_value, alive = values[t], 1.0 - dones[t]
        returns = advantages + values

    b_obs, b_masks = obs.flatten(0, 1), masks.flatten(0, 1)
    b_actions, b_logprobs = actions.flatten(), logprobs.flatten()
    b_advantages, b_returns, b_values = advantages.flatten(), returns.flatten(), values.flatten()
    for _ in range(UPDATE_EPOCHS):
        for mb in np.array_split(rng.permutation(batch_size), NUM_MINIBATCHES):
            policy = agent.policy(b_obs[mb], b_masks[mb])
            ratio = (policy.log_prob(b_actions[mb]) - b_logprobs[mb]).exp()
            advantage = b_advantages[mb]
            advantage = (advantage - advantage.mean()) / (advantage.std() + 1e-8)
            clipped = ratio.clamp(1 - CLIP_COEF, 1 + CLIP_COEF)
            pg_loss = torch.max(-advantage * ratio, -advantage * clipped).mean()

            newvalue = agent.critic(b_obs[mb]).flatten()
            v_clipped = b_values[mb] + (newvalue - b_values[mb]).clamp(-CLIP_COEF, CLIP_COEF)
            squares = torch.max((newvalue - b_returns[mb]) ** 2, (v_clipped - b_returns[mb]) ** 2)
            loss = pg_loss - ENT_COEF * policy.entropy().mean() + VF_COEF * 0.5 * squares.mean()

            optimizer.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(agent.parameters(), MAX_GRAD_NORM)
            optimizer.step()

    if (iteration + 1) % max(num_iterations // 20, 1) == 0 and envs.return_queue:
        print(f"{(iteration + 1) * batch_size} decisions: return {np.mean(envs.return_queue):.2f}", flush=True)

if args.save:
    torch.save(agent.state_dict(), args.save)

report(choose, args.test, args.rounds, args.baselines)
