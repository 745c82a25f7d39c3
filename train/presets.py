"""Hyperparameters per (environment, algorithm), with defaults for environments without an entry.

The defaults suit these tasks: many lanes, big minibatches, no discount (an episode's return is
minus its cost), small exploration noise, since accelerations of a fraction of the limit matter.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any, Literal

from torch import nn

from agents.residual import Scale

Algo = Literal["ppo", "sac", "td3", "recurrent_ppo", "maskable_ppo"]


@dataclass(frozen=True)
class Tutoring:
    """How a network learns what a tutor would command.

    Attributes:
        steps: of every lane in a round.
        batch: rows of one step of the optimiser.
        keep: how many rounds' rows are learnt from.
        draws: rows that are drawn of these in a round; 0 for each of them once.
        handover: rounds after which the tutor flies no episode any more; 0 for none from the start.
        largest: what is wanted is cut off there, over the longest action.
    """

    steps: int = 600
    batch: int = 2048
    keep: int = 6
    draws: int = 0
    handover: int = 0
    largest: float = 1.0


@dataclass(frozen=True)
class Preset:
    """How to train one algorithm on one environment.

    Attributes:
        lanes: environments that fly side by side, agents of all teams counted.
        model: arguments of the SB3 algorithm. Learning rates fall linearly to a twentieth.
        policy: arguments of its policy (`net_arch`, `log_std_init`, ...).
        sets: width of the network that reads what a row lists in any order (PPO only); 0 for none.
        pictures: width of the network that reads pictures; 0 for SB3's own.
        tutoring: what a round of `--tutor N` is.
        imitation: steps in which `--imitate LAW` gathers what the law would do.
        validation: episodes of a validation.
        settings: of the environment, in training and validation.
        residual_scale: what a residual may add to a law, over the longest action; one for all
            numbers of an action, or one for each.
        reads: fields of the row that a residual reads, beside the law's command; empty for the
            row as it is without the command.
        reward_floor, unit: see `train.vec_env.LaneVecEnv`.
    """

    lanes: int
    model: dict[str, Any]
    policy: dict[str, Any] = field(default_factory=dict)
    sets: int = 0
    pictures: int = 0
    tutoring: Tutoring = Tutoring()
    imitation: int = 0
    validation: int = 1000
    settings: dict[str, Any] = field(default_factory=dict)
    residual_scale: Scale = 0.3
    reads: tuple[str, ...] = ()
    reward_floor: float = float("-inf")
    unit: float = 1.0


ON_POLICY = {
    "n_steps": 200,
    "batch_size": 2048,
    "n_epochs": 6,
    "gamma": 1.0,
    "gae_lambda": 0.95,
    "learning_rate": 1e-3,
}
OFF_POLICY = {
    "batch_size": 1024,
    "gamma": 0.999,
    "learning_rate": 1e-3,
    "train_freq": 1,
    "gradient_steps": 4,
}
SMALL = {"net_arch": [64, 64]}

DEFAULTS: dict[Algo, Preset] = {
    "ppo": Preset(256, ON_POLICY, SMALL | {"log_std_init": -1.5}),
    "recurrent_ppo": Preset(
        128,
        ON_POLICY | {"n_steps": 100, "n_epochs": 4},
        SMALL | {"log_std_init": -1.5, "lstm_hidden_size": 64, "enable_critic_lstm": True},
    ),
    "maskable_ppo": Preset(64, ON_POLICY | {"learning_rate": 3e-4, "ent_coef": 0.01}, SMALL),
    "sac": Preset(64, OFF_POLICY | {"ent_coef": "auto_0.01", "learning_starts": 20_000}, SMALL),
    "td3": Preset(64, OFF_POLICY | {"learning_starts": 20_000}, SMALL),
}

TERMINAL = Preset(256, ON_POLICY, SMALL | {"log_std_init": -1.5}, reward_floor=-3.0)
# A push to either side is as good here: only noise as large as the pushes finds out that both are.
# Half the width and no tanh decide in half the time, as well.
SIDES = Preset(
    256,
    ON_POLICY | {"n_steps": 100, "gae_lambda": 0.99},
    {"net_arch": [32, 32], "activation_fn": nn.ReLU, "log_std_init": 0.0},
    reward_floor=-1.0,
)
RECALL = DEFAULTS["recurrent_ppo"]
PRESETS: dict[tuple[str, Algo], Preset] = {
    ("visenvs/Rendezvous-v0", "ppo"): TERMINAL,
    ("visenvs/Tracking2D-v0", "ppo"): SIDES,
    ("visenvs/Tracking2D-v0", "recurrent_ppo"): replace(
        RECALL,
        model=RECALL.model | {"gae_lambda": 0.99},
        policy=RECALL.policy | {"log_std_init": -0.7},
        reward_floor=-1.0,
    ),
    ("visenvs/BearingsOnly-v0", "ppo"): Preset(
        256,
        ON_POLICY | {"n_steps": 150, "gamma": 0.99},
        SMALL | {"log_std_init": -0.5},
    ),
    # Decisions in half a second and rewards minutes later: nearly all the credit comes from the
    # potential; the arena without the physics library is the same to the robots.
    ("visenvs/Herding-v0", "maskable_ppo"): Preset(
        64,
        ON_POLICY
        | {"n_steps": 256, "batch_size": 2048, "n_epochs": 3, "gamma": 0.998, "gae_lambda": 0.9}
        | {"learning_rate": 2e-4, "ent_coef": 0.001, "target_kl": 0.02},
        sets=96,
        imitation=600_000,
        validation=100,
        settings={"arena": "kinematic"},
    ),
    # whole episodes, all of one length: parts of them would teach one phase of the flight at a
    # time; a push is held for four seconds, since noise at every step hardly moves the aircraft. A
    # linear correction of few numbers: whole rows drown in a million steps what a flight teaches
    ("visenvs/Mapping-v0", "ppo"): Preset(
        128,
        ON_POLICY
        | {
            "n_steps": 120,
            "batch_size": 1920,
            "n_epochs": 5,
            "learning_rate": 1.5e-3,
            "gamma": 0.99,
            "max_grad_norm": 2.0,
            "use_sde": True,
            "sde_sample_freq": 8,
        },
        {"net_arch": {"pi": [], "vf": [64, 64]}, "log_std_init": -1.0},
        residual_scale=(0.6, 0.6, 0.1, 0.1),
        reads=("r_V_N", "v_V_N"),
        unit=0.1,
    ),
    ("visenvs/Formation-v0", "ppo"): Preset(
        256,
        ON_POLICY | {"n_steps": 100, "gamma": 0.98, "gae_lambda": 0.8, "batch_size": 3200},
        SMALL | {"log_std_init": -1.5},
        reward_floor=-0.1,  # a change of the command is no policy's fault
        unit=0.02,
    ),
    # whole flights of 400 steps; a push held for a second moves the vehicle, noise at every step
    # only costs (generalised state-dependent exploration, Raffin et al. 2021)
    ("visenvs/Avoidance-v0", "ppo"): Preset(
        128,
        ON_POLICY
        | {
            "n_steps": 400,
            "batch_size": 5120,
            "n_epochs": 4,
            "learning_rate": 4e-4,
            "gamma": 0.998,
            "use_sde": True,
            "sde_sample_freq": 20,
        },
        {"net_arch": [32, 32], "log_std_init": -3.0},
        sets=24,
        residual_scale=0.15,
        reward_floor=-1.0,
    ),
}

# Where pictures are observed. Five of them a second, so that a flight has a hundred; perfect
# information costs nothing and changes no picture; whole flights in a round. What a network cannot
# tell yet, it learns from what the tutor does off its course; half the longest acceleration is more
# than a flight in time ever needs.
PICTURES: dict[tuple[str, Algo], Preset] = {
    ("visenvs/Avoidance-v0", "ppo"): Preset(
        256,
        ON_POLICY
        | {
            "n_steps": 100,
            "batch_size": 1280,
            "n_epochs": 3,
            "learning_rate": 2e-4,
            "gamma": 0.99,
            "use_sde": True,
            "sde_sample_freq": 5,
        },
        {"net_arch": [64], "activation_fn": nn.ReLU, "log_std_init": -3.5},
        pictures=128,
        tutoring=Tutoring(100, 256, 16, draws=200_000, handover=6, largest=0.5),
        validation=200,
        settings={"estimator": "truth", "dt": 0.2},
        reward_floor=-300.0,
        unit=50.0,
    ),
}


def preset_for(env_id: str, algo: Algo, pictures: bool = False) -> Preset:
    """The preset of this pair, or the algorithm's defaults."""
    known = PICTURES if pictures else PRESETS
    return known.get((env_id, algo), DEFAULTS[algo])
