"""What every agent made of Stable-Baselines3 adds to it: flat weights, a rate for every update.

``off_policy`` and ``on_policy`` build on it; an algorithm's file in ``algorithms`` only names the
class of Stable-Baselines3 and its options.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from operator import attrgetter
from typing import TYPE_CHECKING, Any, ClassVar

import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import Logger
from torch import nn

from steersman.learning import networks
from steersman.learning.networks import Net
from steersman.learning.problem import Problem
from steersman.learning.snapshot import Tree, fill

if TYPE_CHECKING:
    from steersman.learning.algorithms.base import AgentComponent

# A policy's action beyond this counts as saturated.
AT_LIMIT = 0.99
# Largest action that a network begins with, so that tanh leaves it a slope.
_STEEPEST = 0.95
_NAN = float("nan")


class SteeringAgent(BaseAlgorithm):
    """An algorithm of Stable-Baselines3 as the training loop uses it.

    Attributes:
        rate: learning rate as a function of the environment steps at an update; None:
            Stable-Baselines3's own.
        operators: ONNX operators after the policy's hidden layers and after its output.
        demonstrable: whether the demonstrator may act.
        sampled_steps: actions that the policy gave while it drove.
        demonstrated_steps: actions of the demonstrator that were executed.
        saturated_steps: actions of the policy at a limit, before exploration noise.
        last_losses: actor's loss, critic's loss and mean value at the last training; NaN before.
        counters: names of the attributes that count; they are part of every snapshot.
    """

    rate: Callable[[float], float] | None = None
    operators = ("Relu", "Tanh")
    demonstrable = False
    demonstrated_steps = 0
    saturated_steps = 0
    sampled_steps = 0
    last_losses: tuple[float, float, float] = (_NAN, _NAN, _NAN)
    counters: ClassVar[tuple[str, ...]] = (
        *("num_timesteps", "_n_updates", "_current_progress_remaining"),
        *("sampled_steps", "saturated_steps", "last_losses"),
    )
    _n_updates: int
    _actor: Net | None = None

    def _setup_learn(self, *words: Any, **named: Any) -> tuple[int, BaseCallback]:
        # Stable-Baselines3 would log to a folder of its own among the system's temporary ones.
        self.set_logger(Logger(folder=None, output_formats=[]))
        return super()._setup_learn(*words, **named)

    def opens(self) -> bool:
        """Whether a stage of a warm start is due before the next step."""
        return False

    def open(self) -> None:
        """Do what a warm start has due."""

    def current_rate(self) -> float:
        """Learning rate of the next update."""
        return self._rate(self.num_timesteps)

    def _rate(self, step: float) -> float:
        if self.rate is None:
            return float(self.lr_schedule(self._current_progress_remaining))
        return self.rate(step)

    def act(self, features: Any) -> Any:
        """The policy's actions (n, m) in [-1, 1] for features (n, k), without noise."""
        return networks.act(self.actor_net(), features, self.operators)

    def actor_net(self) -> Net:
        """The weights from the features to the mean action, laid flat at the first call."""
        if self._actor is None:
            self._actor = lay_flat(mean_layers(_actors(self.policy)[0]))
        return self._actor

    def weights(self) -> dict[str, Any]:
        """All weights and the optimisers' moments, as arrays that are torch's memory.

        Adam makes its moments at its first step; here they are made before, as Adam would.
        """
        self.actor_net()
        states, variables = self._get_torch_save_params()
        named = dict(self.policy.named_parameters())
        named |= {name: attrgetter(name)(self) for name in variables}
        optimisers = [attrgetter(name)(self) for name in states if name.endswith("optimizer")]
        owners = {p: o for o in optimisers for group in o.param_groups for p in group["params"]}
        out = {}
        for name, parameter in named.items():
            out[name] = parameter.data.numpy()
            if parameter in owners:
                state = owners[parameter].state[parameter]
                if not state:
                    state["step"] = torch.tensor(0.0, dtype=torch.float32)
                    state["exp_avg"] = torch.zeros_like(parameter)
                    state["exp_avg_sq"] = torch.zeros_like(parameter)
                out |= {f"{name}.{part}": value.numpy() for part, value in state.items()}
        return out

    def snapshot(self) -> dict[str, Any]:
        """All that changes from step to step, the environment apart; taken between two steps."""
        return {
            "weights": self.weights(),
            "counters": {name: getattr(self, name) for name in self.counters},
            "observation": self._last_obs,
        }

    def restore(self, saved: Tree) -> None:
        """Go on from a snapshot.

        Raises:
            DataError: it is of another network.
        """
        fill(self.weights(), saved["weights"])
        for name in self.counters:
            setattr(self, name, saved["counters"][name])
        self._last_obs = saved["observation"]


def without_compiler(optimiser: type[torch.optim.Optimizer]) -> None:
    """Let optimisers be made without torch's compiler, whose import takes seconds.

    torch imports ``torch._dynamo`` at the first call of these methods to keep it away from them.
    It is away as long as nothing compiles, so that they can be called as they are.
    """
    for method in vars(optimiser).values():
        plain = getattr(method, "__wrapped__", None)
        if getattr(method, "__module__", None) == optimiser.__module__ and plain is not None:
            vars(plain).setdefault("__dynamo_disable", plain)


without_compiler(torch.optim.Optimizer)


def lay_flat(modules: Iterable[Any]) -> Net:
    """Make the parameters of three linear layers views of one flat array."""
    parameters = [p for module in modules for p in module.parameters()]
    flat = torch.cat([p.data.reshape(-1) for p in parameters])
    at = 0
    for p in parameters:
        p.data = flat[at : at + p.numel()].view(p.shape)
        at += p.numel()
    sizes = [tuple(p.shape) for p in parameters[::2]]
    return networks.view_net(flat.numpy(), (sizes[0][1], *(rows for rows, _ in sizes)))


def _actors(policy: Any) -> list[Any]:
    """The network that acts, and its target if it has one."""
    names = ("actor", "actor_target", "q_net", "q_net_target")
    return [getattr(policy, name) for name in names if hasattr(policy, name)] or [policy]


def mean_layers(policy: Any) -> list[Any]:
    """The parts of an SB3 actor (or of PPO's policy) from the features to the mean action."""
    if hasattr(policy, "q_net"):
        return [policy.q_net]
    if hasattr(policy, "action_net"):
        return [policy.mlp_extractor.policy_net, policy.action_net]
    return [policy.latent_pi, policy.mu] if hasattr(policy, "latent_pi") else [policy.mu]


def start_at_base(policy: Any, problem: Problem, settings: AgentComponent) -> None:
    """Make the mean action of an SB3 policy (and of its target) the base's for every observation.

    An agent with a base begins as this base: a random network would spoil it from the first step
    on, and the data collected with it (Silver, Allen, Tenenbaum and Kaelbling, Residual policy
    learning, arXiv:1812.06298, 2018). Zero weights of the last layer alone leave it a gradient, as
    the hidden units differ. Without a base nothing is changed.

    Args:
        policy: of Stable-Baselines3.
        problem: its correction begins at zero, its parameters at the base's own.
        settings: the algorithm.
    """
    if problem.base is None:
        return
    own = [each.action(problem.base) for each in problem.adjustments()]
    own = own or [0.0] * len(problem.turned)
    bias = torch.tensor(own, dtype=torch.float32).clamp(-_STEEPEST, _STEEPEST)
    if settings.operators[1] == "Tanh":
        bias = torch.atanh(bias)
    if settings.levels:
        places = networks.nearest([own], settings.levels)[0]
        bias = torch.nn.functional.one_hot(torch.from_numpy(places), len(settings.levels))[0]
    for actor in _actors(policy):
        last = mean_layers(actor)[-1]
        output = [layer for layer in last.modules() if isinstance(layer, nn.Linear)][-1]
        output.weight.data.zero_()
        output.bias.data[:] = bias
