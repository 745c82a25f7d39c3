"""The n-step-ahead laws: their limits, their horizon, their memory, and what cannot break them."""

import pickle
from fractions import Fraction
from math import floor

import numpy as np
import pytest

from agents.registry import load
from visenvs.core.registry import find_law, load_task
from visenvs.guidance.nsa import horizon
from visenvs.guidance.planner import PLANE, begin, cost, make_tape

NAMES = ("dt", "t_f", "s_x", "s_v", "camera", "min_range", "sigma_range", "sigma_angle")
SETTINGS = np.dtype([(name, "i8" if name == "camera" else "f8") for name in NAMES])
FIXED, GIMBAL = 0, 1
TASKS = [(2, FIXED), (3, FIXED), (3, GIMBAL)]


def settings(
    dt=0.1,
    t_f=10.0,
    s_x=1.0,
    s_v=0.1,
    camera=FIXED,
    min_range=0.3,
    sigma_range=0.3,
    sigma_angle=0.0,
):
    return np.array([(dt, t_f, s_x, s_v, camera, min_range, sigma_range, sigma_angle)], SETTINGS)


def beliefs(D, times, seed=0):
    """Targets ahead whose range is known to a fifth, one row for each time to go."""
    rng, n = np.random.default_rng(seed), D * (D + 1) // 2
    fields = [("rhat_TV_N", (D,)), ("chol", (n,)), ("v_V_N", (D,)), ("t_go", ())]
    rows = np.zeros(len(times), [(name, "f8", shape) for name, shape in fields])
    for row, T in zip(rows, times, strict=True):
        sight = np.array([1.0, *rng.uniform(-0.3, 0.3, D - 1)])
        row["rhat_TV_N"], row["t_go"] = 25.0 * sight, T
        row["v_V_N"] = [3.0, *rng.uniform(-1, 1, D - 1)]
        root = np.column_stack([5.0 * sight, 0.3 * np.eye(D)])
        row["chol"] = np.linalg.cholesky(root @ root.T)[np.tril_indices(D)]
    return rows


def decided(name, rows, cfg, memory=None):
    """Commands of a law; a memory that is handed in is carried on, else all rows start anew."""
    law = find_law(name)
    commands = np.full(rows["rhat_TV_N"].shape, np.nan)
    if law.memory is None:
        law.decide(rows, cfg, commands)
    else:
        law.decide(rows, cfg, fresh(name, rows, cfg) if memory is None else memory, commands)
    return commands


def fresh(name, rows, cfg):
    return np.zeros((len(rows), find_law(name).memory(cfg[0], rows["rhat_TV_N"].shape[1])))


@pytest.mark.kernel
@pytest.mark.parametrize(("D", "camera"), TASKS)
@pytest.mark.parametrize("name", ["nsa-0", "ahead-0"])
def test_without_a_horizon_it_is_the_terminal_law(name, D, camera):
    rows, cfg = beliefs(D, [10.0, 3.0, 0.1, 0.0]), settings(camera=camera)
    assert np.array_equal(decided(name, rows, cfg), decided("lq", rows, cfg))


@pytest.mark.kernel
@pytest.mark.parametrize(("D", "camera"), TASKS)
def test_one_step_ahead_it_is_nearly_the_linearised_law(D, camera):
    """OSA takes one step down the gradient of one push's cost; this law goes to its minimum."""
    rows, cfg = beliefs(D, [10.0, 8.0, 6.0, 4.0]), settings(camera=camera)
    terminal, linear, exact = (decided(name, rows, cfg) for name in ("lq", "osa", "nsa-1"))
    push = np.linalg.norm(linear - terminal, axis=1)
    assert (np.linalg.norm(exact - linear, axis=1) < 0.02 * push).all()


@pytest.mark.kernel
@pytest.mark.parametrize(("D", "camera"), TASKS)
def test_a_horizon_ends_at_the_terminal_time(D, camera):
    """The last push can no longer be repaid: what the image after it tells is of no more use."""
    rows, cfg = beliefs(D, [1.2, 0.8, 0.1, 0.0]), settings(camera=camera)
    whole = decided("nsa", rows, cfg)
    for name in ("nsa-12", "nsa-13", "nsa-1000", "nsa-" + 30 * "9", "ahead-100", "ahead-100.0"):
        assert np.array_equal(decided(name, rows, cfg), whole)
    assert not np.array_equal(decided("nsa-10", rows, cfg)[0], whole[0])
    assert np.array_equal(decided("nsa-10", rows, cfg)[1:], whole[1:])


@pytest.mark.kernel
def test_a_belief_from_before_the_start_is_planned_as_far_as_the_memory_goes():
    rows, cfg = beliefs(3, [1.5, 1.0]), settings(t_f=1.0)
    assert np.array_equal(decided("nsa", rows, cfg), decided("nsa-10", rows, cfg))


@pytest.mark.kernel
def test_a_share_of_the_steps_left_is_rounded():
    """(4.66), halves upwards, against exact arithmetic."""
    for left in range(0, 201, 7):
        for percent in range(101):
            expected = floor(Fraction(percent * left, 100) + Fraction(1, 2))
            assert horizon(left, 0, float(percent)) == expected
    assert horizon(7, 100, -1.0) == 7
    assert horizon(100, 7, -1.0) == 7


@pytest.mark.kernel
@pytest.mark.parametrize("percent", [25, 60])
def test_a_share_of_the_steps_left_is_that_many_steps(percent):
    rows, cfg = beliefs(3, [2.0]), settings(camera=GIMBAL)
    name = f"nsa-{percent * 20 // 100}"
    assert np.array_equal(decided(f"ahead-{percent}", rows, cfg), decided(name, rows, cfg))


@pytest.mark.kernel
@pytest.mark.parametrize("name", ["nsa", "nsa-4", "ahead-60"])
@pytest.mark.parametrize(("D", "camera"), TASKS)
def test_a_batch_is_decided_as_its_rows_alone_bit_for_bit(name, D, camera):
    """With rows of different horizons, and a second decision that starts from the first's plans."""
    rows, cfg = beliefs(D, [1.5, 0.3, 1.0, 0.0, 0.7]), settings(camera=camera)
    memory = fresh(name, rows, cfg)
    alone = memory.copy()
    for _ in range(2):
        together = decided(name, rows, cfg, memory)
        for i in range(len(rows)):
            assert np.array_equal(
                together[i : i + 1], decided(name, rows[i : i + 1], cfg, alone[i : i + 1])
            )
        assert np.array_equal(memory, alone)
        rows["t_go"] = np.maximum(rows["t_go"] - 0.1, 0.0)


def onward(row, push, cfg):
    """The belief a step later, under the terminal law and a push, if the image is as predicted."""
    tape = make_tape(1, 2)
    begin(row["rhat_TV_N"], row["v_V_N"], row["chol"], row["t_go"], cfg[0], 1, tape)
    cost(PLANE, push[None, :].copy(), cfg[0], tape)
    row["rhat_TV_N"], row["v_V_N"] = tape.states[1, :2], tape.states[1, 2:4]
    row["chol"] = np.linalg.cholesky(tape.P[1, 0])[np.tril_indices(2)]
    row["t_go"] -= cfg["dt"][0]


def test_what_was_planned_is_flown_while_images_are_as_predicted_and_a_cold_start_agrees():
    """The principle of optimality: the rest of a best plan is a best plan.

    Plans are finished when 1e-7 of the cost is left to gain; the minimum is so flat that pushes
    may then still be two percent off.
    """
    rows, cfg = beliefs(2, [10.0] * 6), settings(s_v=0.0)
    memory = fresh("nsa", rows, cfg)
    pushes = decided("nsa", rows, cfg, memory) - decided("lq", rows, cfg)
    assert (np.linalg.norm(pushes, axis=1) > 0.05).all()
    for _ in range(4):
        for row, push in zip(rows, pushes, strict=True):
            onward(row, push, cfg)
        promised, terminal = memory[:, :2].copy(), decided("lq", rows, cfg)
        pushes = decided("nsa", rows, cfg, memory) - terminal
        cold = decided("nsa", rows, cfg) - terminal
        size = np.linalg.norm(pushes, axis=1)
        assert (np.linalg.norm(pushes - promised, axis=1) < 0.02 * size).all()
        assert (np.linalg.norm(pushes - cold, axis=1) < 0.02 * size).all()


@pytest.mark.kernel
def test_a_memory_is_the_rest_of_the_plan():
    """Of n - 1 steps; nothing is planned beyond the horizon."""
    rows, cfg = beliefs(3, [1.5]), settings(t_f=2.0)
    memory = fresh("nsa-4", rows, cfg)
    assert memory.shape == (1, 20 * 3)
    decided("nsa-4", rows, cfg, memory)
    plan = memory.reshape(20, 3)
    assert (np.abs(plan[:3]).max(axis=1) > 0.0).all()
    assert not plan[3:].any()


def test_an_episode_that_starts_clears_its_own_memory():
    task = load_task("visenvs/Rendezvous-v0")
    config = task.scenarios["random"]
    policy = load("nsa-20", task, config).policy
    rows = task.observation.pack(
        {
            "rhat_TV_N": [[25.0, 5.0, 2.0], [30.0, -4.0, 1.0]],
            "chol": [[5.0, 1.0, 0.3, 0.5, 0.0, 0.3]] * 2,
            "v_V_N": [[3.0, 1.0, 0.0]] * 2,
            "innovation": [[0.0, 0.0]] * 2,
            "seen": [1.0, 1.0],
            "t_go": [5.0, 5.0],
        }
    )
    _, memory = policy.predict(rows)
    assert memory.any(axis=1).all()
    later = rows.copy()
    later[:, :2] *= 0.9
    cold, _ = policy.predict(later)
    warm, _ = policy.predict(later, state=memory.copy())
    mixed, kept = policy.predict(later, state=memory.copy(), episode_start=np.array([True, False]))
    assert not np.array_equal(warm, cold)
    assert np.array_equal(mixed, [cold[0], warm[1]])
    assert kept.shape == memory.shape


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("nsa--1", r"unknown policy 'nsa--1'; did you mean 'nsa'\?"),
        ("nsa-1.5", "unknown policy 'nsa-1.5'"),
        ("nsa-", "unknown policy 'nsa-'"),
        ("nsa-x", "unknown policy 'nsa-x'"),
        ("ahead--5", "unknown policy 'ahead--5'"),
        ("ahead-nan", "unknown policy 'ahead-nan'"),
        ("ahead", "unknown policy 'ahead'"),
        (
            "ahead-101",
            "ahead-101: a horizon is at most 100 percent of what is left; write ahead-100",
        ),
        ("ahead-100.5", "ahead-100.5: a horizon is at most 100 percent"),
    ],
)
def test_horizons_that_are_none_are_refused_by_name(name, message):
    task = load_task("visenvs/Rendezvous-v0")
    with pytest.raises(ValueError, match=message):
        load(name, task, task.scenarios["random"])


@pytest.mark.kernel
@pytest.mark.parametrize("D", [2, 3])
@pytest.mark.parametrize("depth", [-20.0, 0.0, 0.1])
def test_a_target_behind_a_fixed_camera_leaves_the_terminal_law(D, depth):
    """Nothing can be seen on the way, so there is nothing to push for."""
    rows, cfg = beliefs(D, [1.0]), settings(s_x=1e-3, s_v=0.0)
    rows["rhat_TV_N"][0, 0] = depth
    assert np.array_equal(decided("nsa", rows, cfg), decided("lq", rows, cfg))


@pytest.mark.kernel
@pytest.mark.parametrize(("D", "camera"), TASKS)
def test_wherever_the_target_is_believed_the_commands_are_finite(D, camera):
    """Behind the camera, abeam, at the camera itself, and nearer than it can see; then later on."""
    rows, cfg = beliefs(D, [1.5] * 6), settings(camera=camera)
    rows["rhat_TV_N"][:, 0] = [-25.0, 0.0, 1e-9, 0.2, 0.0, 3.0]
    rows["rhat_TV_N"][4] = 0.0
    memory = fresh("nsa", rows, cfg)
    for _ in range(2):
        assert np.isfinite(decided("nsa", rows, cfg, memory)).all()
        assert np.isfinite(memory).all()
        rows["v_V_N"] *= -1.0


@pytest.mark.kernel
@pytest.mark.parametrize(("D", "camera"), TASKS)
def test_perfect_information_leaves_the_terminal_law(D, camera):
    rows, cfg = beliefs(D, [1.5, 0.5]), settings(camera=camera)
    rows["chol"] = 0.0
    assert np.array_equal(decided("nsa", rows, cfg), decided("lq", rows, cfg))


@pytest.mark.kernel
@pytest.mark.parametrize(("D", "camera"), TASKS)
def test_a_singular_covariance_is_no_obstacle(D, camera):
    """Only the first axis is uncertain, as in (4.69) for a first measurement of zero."""
    rows, cfg = beliefs(D, [1.5, 0.5]), settings(camera=camera)
    rows["chol"] = 0.0
    rows["chol"][:, 0] = 5.0
    commands = decided("nsa", rows, cfg)
    assert np.isfinite(commands).all()
    assert not np.array_equal(commands, decided("lq", rows, cfg))


@pytest.mark.kernel
def test_a_belief_that_is_alike_to_both_sides_has_no_side_to_push_to():
    rows, cfg = beliefs(2, [1.5]), settings()
    rows["rhat_TV_N"], rows["v_V_N"], rows["chol"] = [25.0, 0.0], [3.0, 0.0], [5.0, 0.0, 0.3]
    assert np.array_equal(decided("nsa", rows, cfg), decided("lq", rows, cfg))


def test_a_law_can_be_sent_to_another_process():
    rows, cfg = beliefs(2, [1.0]), settings()
    law, commands = pickle.loads(pickle.dumps(find_law("nsa-3"))), np.empty((1, 2))
    law.decide(rows, cfg, fresh("nsa-3", rows, cfg), commands)
    assert np.array_equal(commands, decided("nsa-3", rows, cfg))
