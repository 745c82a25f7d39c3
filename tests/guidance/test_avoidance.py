"""What makes an obstacle critical, told by where the laws then fly."""

import pickle

import numpy as np
import pytest

from agents.registry import load
from visenvs.core.registry import find_law, laws, load_task
from visenvs.guidance import pn
from visenvs.guidance.collision_cone import coordinates, tangents

pytestmark = pytest.mark.kernel

WAYPOINT, V = np.array([80.0, 0.0, 0.0]), np.array([10.0, 0.0, 0.0])
LAWS = ["cone-pn", "cone-meg", "cone-lq", "cone-osa", "dgg", "ngg", "hug", "dgg-target"]


def to_tangent(X, W, d, first=True):
    """The aiming point and its time to go."""
    p1, p2 = np.empty(3), np.empty(3)
    tangents(X, W, d, coordinates(X, W, d)[0], p1, p2)
    p = p1 if first else p2
    return p, p[0] / W[0]


def sequential(p, T, V=V):
    """The lateral command to a point (3.29)."""
    a = np.empty(3)
    pn.command(p, V, T, a)
    a[0] = 0.0
    return a


def test_the_aim_is_the_nearer_tangent_and_its_time_to_go(air):
    X, d = np.array([30.0, 3.0, -4.0]), 8.0
    row = air.belief(WAYPOINT, V, [X], [d])
    assert np.allclose(
        air.decided("cone-pn", row, air.settings()), sequential(*to_tangent(X, V, d)), rtol=1e-12
    )


def test_the_nearest_time_to_go_wins_whatever_the_order_of_the_row(air):
    far, near = np.array([40.0, 3.0, 0.0]), np.array([20.0, -1.0, 2.0])
    expected = sequential(*to_tangent(near, V, 5.0))
    for order in ([far, near], [near, far]):
        row = air.belief(WAYPOINT, V, order, [5.0, 5.0])
        assert np.allclose(air.decided("cone-pn", row, air.settings()), expected, rtol=1e-12)


BESIDE, BEHIND, HEAD_ON = [30.0, 12.0, 0.0], [-30.0, 1.0, 0.0], [30.0, 0.0, 0.0]
HARMLESS = [(name, X) for name in LAWS for X in (BESIDE, BEHIND, HEAD_ON)]
HARMLESS.remove(("hug", BESIDE))


@pytest.mark.parametrize(("name", "X"), HARMLESS)
def test_what_is_no_danger_is_as_if_it_were_not_there(air, name, X):
    """Head-on it is not decided yet to which side."""
    cfg, memory = air.settings(), air.fresh(name, air.settings())
    alone = air.decided(name, air.belief(WAYPOINT, V, [], []), cfg)
    found = air.decided(name, air.belief(WAYPOINT, V, [X], [8.0]), cfg, memory)
    assert np.array_equal(found, alone)
    assert not memory.any()


@pytest.mark.parametrize("name", ["cone-pn", "cone-meg", "cone-lq", "cone-osa"])
@pytest.mark.parametrize(
    "change",
    [{"t_critical": 2.9}, {"t_min": 3.1}, {}],
    ids=["not yet", "dropped", "beyond the waypoint"],
)
def test_the_time_test(air, name, change):
    """An obstacle 30 m away at 10 m/s: its tangent is nearly 3 s away."""
    X, d, waypoint = [30.0, 0.5, 0.0], 1.0, WAYPOINT if change else np.array([29.0, 0.0, 0.0])
    cfg = air.settings(**change)
    alone = air.decided(name, air.belief(waypoint, V, [], []), cfg)
    assert np.array_equal(air.decided(name, air.belief(waypoint, V, [X], [d]), cfg), alone)
    row = air.belief(WAYPOINT, V, [X], [d])
    assert not np.array_equal(air.decided(name, row, air.settings()), alone)


def after(air, name, second, cfg=None):
    """The command to a second row, after a first in which the obstacle in slot 3 was critical."""
    cfg = air.settings() if cfg is None else cfg
    memory = air.fresh(name, cfg)
    air.decided(name, air.belief(WAYPOINT, V, [[30.0, 3.0, 0.0]], [8.0], slots=[3]), cfg, memory)
    return air.decided(name, second, cfg, memory), memory


def test_with_a_latch_what_was_critical_stays_so(air):
    """The velocity has turned out of the cone; only the law that remembers still aims."""
    turned, X, d = np.array([10.0, -4.0, 0.0]), np.array([28.0, 3.3, 0.0]), 8.0
    assert coordinates(X, turned, d)[2] < 0.0
    away = [50.0, 30.0, 0.0]  # another, harmless, comes first in the row
    row = air.belief(WAYPOINT, turned, [away, X], [d, d], slots=[0, 3])
    aimed, memory = after(air, "cone-pn", row)
    assert np.allclose(aimed, sequential(*to_tangent(X, turned, d), turned), rtol=1e-12)
    assert np.array_equal(memory[0], np.eye(memory.shape[1])[3])
    literal, forgotten = after(air, "cone-pn-literal", row)
    assert np.allclose(literal, sequential(WAYPOINT, 8.0, turned), rtol=1e-12)
    assert not forgotten.any()


@pytest.mark.parametrize(
    ("X", "d", "slot", "t_min"),
    [
        ([28.0, 3.3, 0.0], 8.0, 3, 2.9),
        ([4.0, 3.0, 0.0], 8.0, 3, 0.1),
        ([28.0, 3.3, 0.0], 8.0, 2, 0.1),
        ([1.0, 9.0, 0.0], 8.0, 3, 0.1),
    ],
    ids=["too near to aim at", "inside the sphere", "another identity", "passed, aim ahead"],
)
def test_a_latch_opens(air, X, d, slot, t_min):
    turned = np.array([10.0, -4.0, 0.0])
    row = air.belief(WAYPOINT, turned, [X], [d], slots=[slot])
    command, memory = after(air, "cone-pn", row, air.settings(t_min=t_min))
    assert np.allclose(command, sequential(WAYPOINT, 8.0, turned), rtol=1e-12)
    assert not memory.any()


def test_a_latch_opens_where_the_track_is_lost(air):
    row = air.belief(WAYPOINT, V, [], [])
    _, memory = after(air, "cone-pn", row)
    assert not memory.any()


@pytest.mark.parametrize("lateral", [0, 1])
@pytest.mark.parametrize("name", ["dgg", "ngg", "hug", "dgg-target", "cone-pn"])
def test_a_moving_obstacle_is_one_that_stands_still_in_its_own_frame(air, name, lateral):
    """The command is that for the relative velocity, as far as the waypoint plays no part."""
    X, d, O = np.array([30.0, 3.0, -4.0]), 8.0, np.array([-2.0, 1.0, 0.5])
    cfg = air.settings(lateral=lateral)
    moving = air.belief(WAYPOINT, V, [X], [d], velocities=[O], t_go=8.0)
    still = air.belief(WAYPOINT, V - O, [X], [d], t_go=8.0)
    expected = air.decided(name, still, cfg)
    assert np.linalg.norm(expected) > 0.5
    assert np.allclose(air.decided(name, moving, cfg), expected, rtol=1e-12)


def test_the_cone_test_on_the_waypoint_sees_what_the_velocity_passes(air):
    drift, X, d = np.array([10.0, 4.0, 0.0]), [40.0, 1.0, 0.0], 8.0
    assert coordinates(np.array(X), drift, d)[2] < 0.0
    row, alone = air.belief(WAYPOINT, drift, [X], [d]), air.belief(WAYPOINT, drift, [], [])
    cfg = air.settings()
    assert np.array_equal(air.decided("dgg", row, cfg), air.decided("dgg", alone, cfg))
    aimed = air.decided("dgg-target", row, cfg)
    assert aimed[1] > air.decided("dgg-target", alone, cfg)[1]  # it stays on its side of it
    row["rhat_WV_N"][0, 0] = -1.0  # a waypoint behind gives no direction
    assert not air.decided("dgg-target", row, cfg).any()


@pytest.mark.parametrize("name", ["dgg-target", "hug"])
def test_what_the_velocity_leads_into_comes_before_what_it_is_only_kept_from(air, name):
    """The near sphere would be passed; the far one would be entered within t_critical."""
    near, far, cfg = [15.0, 9.0, 0.0], [40.0, -3.0, 1.0], air.settings()
    alone = air.belief([90.0, 60.0, 0.0], V, [far], [6.0])
    pair = air.belief([90.0, 60.0, 0.0], V, [near, far], [8.0, 6.0])
    assert np.array_equal(air.decided(name, pair, cfg), air.decided(name, alone, cfg))
    cfg["t_critical"] = 3.0  # there is time for the far one after the near one
    first = air.belief([90.0, 60.0, 0.0], V, [near], [8.0])
    assert np.array_equal(air.decided(name, pair, cfg), air.decided(name, first, cfg))


def test_where_spheres_overlap_the_tangent_farther_from_the_overlap_can_be_taken(air):
    X, Y, d = np.array([30.0, 3.0, 0.0]), np.array([31.0, -5.0, 0.0]), 6.0
    slow = air.settings(t_critical=1e9)
    row = air.belief(WAYPOINT, V, [X, Y], [d, 0.0 * d + 5.0])
    near = sequential(*to_tangent(X, V, d))
    far = sequential(*to_tangent(X, V, d, first=False))
    row["valid_O"][0, 1] = 0.0
    assert np.allclose(air.decided("cone-pn-overlap", row, slow), near, rtol=1e-12)
    row["valid_O"][0, 1] = 1.0
    row["vhat_O_N"][0, 4] = 30.0  # the other one is on no course with us
    assert np.allclose(air.decided("cone-pn", row, slow), near, rtol=1e-12)
    assert np.allclose(air.decided("cone-pn-overlap", row, slow), far, rtol=1e-12)


def test_a_larger_radius_can_be_kept(air):
    X, d, cfg = np.array([30.0, 3.0, -4.0]), 8.0, air.settings()
    row, larger = (air.belief(WAYPOINT, V, [X], [r]) for r in (d, 1.25 * d))
    expected = air.decided("cone-meg", larger, cfg)
    assert np.allclose(air.decided("cone-meg-x1.25", row, cfg), expected, rtol=1e-13)


@pytest.mark.parametrize("name", [*LAWS, "cone-pn-out", "cone-meg-out", "cone-lq-abeam"])
def test_rows_are_decided_one_by_one_and_all_commands_are_finite(air, name):
    """Far and near, inside spheres, at their centre and on them, standing still and flying back."""
    rng, cfg, rows = np.random.default_rng(5), air.settings(), []
    for k in range(40):
        places = rng.normal(size=(6, 3)) * rng.choice([1.0, 10.0, 40.0], size=(6, 1))
        speed = V + rng.normal(size=3) * 3
        if k < 8:
            speed = [0.0 * V, -V, V, [1e-9, 0, 0]][k % 4]
        places[0] *= k % 5 > 0
        places[1, 0] *= k % 3 > 0
        rows.append(
            air.belief(WAYPOINT, speed, places, rng.uniform(1, 20, 6), rng.permutation(6), t_go=8.0)
        )
    rows, law = np.concatenate(rows), find_law(name)
    rows["chol_OV"] = np.tile([2.0, 0.1, 1.0, 0.0, 0.2, 1.0], 6)
    rows["rhat_WV_N"][20:] *= -1.0
    for lateral in (0, 1):
        cfg["lateral"] = lateral
        memory, together = np.zeros((40, law.memory(cfg[0], 3))), np.empty((40, 3))
        law.decide(rows, cfg, memory, together)
        assert np.isfinite(together).all()
        assert np.isfinite(memory).all()
        for i in range(40):
            assert np.array_equal(air.decided(name, rows[i : i + 1], cfg), together[i])


def test_an_identity_that_no_memory_holds_is_refused(air):
    row = air.belief(WAYPOINT, V, [[30.0, 3.0, 0.0]], [8.0], slots=[9])
    with pytest.raises(ValueError, match="slot_O"):
        air.decided("cone-pn", row, air.settings())


def test_words_after_a_name_change_its_rules():
    assert set(LAWS) <= set(laws())
    assert find_law("cone-meg-literal").decide.args[1].latch is False
    rules = find_law("dgg-target-overlap-open-x1.05").decide.args[1]
    assert (rules.overlap, rules.inside, rules.factor) == (True, 0, 1.05)
    for name in ("dgg-", "dgg-tarket", "cone-pn-x", "dggx", "cone", "hug-x-1"):
        assert find_law(name) is None
    with pytest.raises(ValueError, match=r"dgg-x0: a radius is more than 0; write dgg-x1\.05"):
        find_law("dgg-x0")


@pytest.mark.parametrize("name", ["cone-meg", "dgg-target-x1.1", "cone-osa-latch", "hug-told"])
def test_a_law_can_be_sent_to_another_process(air, name):
    row, commands = air.belief(WAYPOINT, V, [[30.0, 3.0, 0.0]], [8.0]), np.empty((1, 3))
    law = pickle.loads(pickle.dumps(find_law(name)))
    law.decide(row, air.settings(), air.fresh(name, air.settings()), commands)
    assert np.array_equal(commands[0], air.decided(name, row, air.settings()))


def test_a_task_without_obstacles_says_what_is_missing():
    task = load_task("visenvs/Rendezvous-v0")
    with pytest.raises(ValueError, match="cone-pn needs rhat_WV_N, rhat_OV_N"):
        load("cone-pn", task, task.scenarios["random"])
