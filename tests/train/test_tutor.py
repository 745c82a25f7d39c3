"""Learning from perfect information: what it commands, and that a network comes closer to it."""

from __future__ import annotations

import numpy as np
import pytest
from stable_baselines3 import PPO

from agents import registry
from agents.residual import Residual
from tests.toys import toys
from train.presets import Tutoring
from train.shaping import potential_of
from train.tutor import TEACHER, learn_from_truth, teacher_of
from train.vec_env import LaneVecEnv
from visenvs.core.config import override
from visenvs.core.lanes import Lanes
from visenvs.core.registry import load_task

TASK = load_task("visenvs/Formation-v0")
CONFIG = TASK.scenarios["random"]
QUIET = {"estimator": "truth", "lag": 1e-3, "a_max": 50.0, "a_max_down": 50.0}
with toys():
    CART = load_task("visenvs/Cart-v0")


def test_the_teacher_is_the_law_with_optimal_gains_on_the_truth():
    config = override(CONFIG, QUIET)
    lanes = Lanes(TASK, config, 5)
    lanes.reset(range(5))
    row = TASK.observation.unpack(lanes.rows)
    w, c = row["offset_rate"][:, None], row["offset_F"]
    turned = np.stack([-w[:, 0] * c[:, 1], w[:, 0] * c[:, 0], 0 * c[:, 2]], axis=1)
    level = np.array([1.0, 1.0, 0.0])
    kp, kd = config.s_r**0.5, (2 * config.s_r**0.5) ** 0.5
    expected = row["ahat_L_F"] + w**2 * c * level
    expected = expected + kp * (row["rhat_LV_F"] - c) + kd * (row["vhat_LV_F"] - turned)
    assert teacher_of(TASK, config)(lanes.records) == pytest.approx(
        expected / config.a_max, abs=1e-4
    )


def test_the_teacher_pays_just_the_potential_behind_a_straight_leader():
    """Ahead and down; to the side, the heading and with it the place turn with the command."""
    changes = QUIET | {
        "profile": "straight",
        "step_times": (0.0, 0.0, 0.0),
        "t_f": 30.0,
        "dt": 0.01,
    }
    config = override(TASK.scenarios["straight"], changes)
    lanes, teacher = Lanes(TASK, config, 1), teacher_of(TASK, config)
    lanes.reset([3])
    lanes.records["r_V_N"] += [3.0, 0.0, 1.0]
    lanes.records["tracking_error"] -= [3.0, 0.0, 1.0]
    promised = potential_of(TASK, config)(lanes.records)[0]
    while not lanes.done[0]:
        lanes.step(teacher(lanes.records).astype(np.float32))
    assert lanes.records["total_cost"][0] == pytest.approx(-promised, rel=0.03)


def test_there_is_no_tutor_where_no_place_is_to_be_kept():
    with pytest.raises(ValueError, match="leave --tutor out"):
        teacher_of(CART, next(iter(CART.scenarios.values())))


def test_there_is_no_tutor_for_pictures_that_no_law_fits():
    herding = load_task("visenvs/Herding-v0")
    seeing = override(herding.scenarios["firmware"], {"observation": "pixels"})
    with pytest.raises(ValueError, match="pictures of visenvs/Herding-v0; leave --tutor out"):
        teacher_of(herding.under(seeing), seeing)


def test_a_correction_makes_the_wanted_action_come_out():
    law = registry.load_law("follow", TASK, CONFIG)
    lanes = LaneVecEnv(TASK, CONFIG, range(8), Residual(law, 0.3))
    rows = lanes.reset()
    wanted = law.predict(rows)[0] + 0.1
    correction = lanes.correction(wanted)
    assert Residual(law, 0.3).combine(law.predict(rows)[0], correction) == pytest.approx(
        np.clip(wanted, -1, 1), abs=1e-6
    )


def test_a_network_comes_closer_to_its_teacher():
    config = override(CONFIG, {"t_f": 6.0, "estimator": "truth"})
    law = registry.load_law("follow", TASK, config)
    lanes, teacher = (
        LaneVecEnv(TASK, config, range(64), Residual(law, 0.3)),
        teacher_of(TASK, config),
    )
    model = PPO("MlpPolicy", lanes, seed=1, n_steps=8, batch_size=64, device="cpu")

    def off():
        """Mean square of what the network lacks along the law's own way, after some images."""
        row, squares = lanes.reset(), []
        for k in range(50):
            if k >= 20:
                said, _ = model.predict(row, deterministic=True)
                squares.append((said - lanes.correction(teacher(lanes.lanes.records))) ** 2)
            row = lanes.step(np.zeros((64, 3), np.float32))[0]
        return float(np.mean(squares))

    before = off()
    assert learn_from_truth(model, lanes, teacher, 5, Tutoring(60, 256)) == 5 * 60 * 64
    assert off() < 0.5 * before


def test_who_sees_pictures_learns_from_a_law_that_is_told_the_truth():
    """Its rows are those of a law that flies with perfect information, whatever lanes see."""
    task = load_task("visenvs/Avoidance-v0")
    told = override(task.scenarios["random"], {"estimator": "truth"})
    seeing = override(told, {"observation": "pixels"})
    law, lanes = Lanes(task, told, 3), Lanes(task, seeing, 3)
    teacher, policy = teacher_of(lanes.task, seeing), registry.load_law(TEACHER, law.task, told)
    state, start = None, np.ones(3, bool)
    law.reset(range(3))
    lanes.reset(range(3))
    for _ in range(30):
        wanted, state = policy.predict(law.rows, state, start)
        assert teacher(lanes.records) == pytest.approx(wanted, abs=1e-6)
        law.step(wanted)
        lanes.step(wanted)
        start = np.zeros(3, bool)
