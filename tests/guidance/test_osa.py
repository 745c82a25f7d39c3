"""The one-step-ahead push against the thesis's matrices and central differences."""

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from visenvs.core.frames import camera_towards
from visenvs.core.registry import laws
from visenvs.guidance import lq

pytestmark = pytest.mark.kernel

NAMES = ("dt", "s_x", "s_v", "camera", "min_range", "sigma_range", "sigma_angle")
SETTINGS = np.dtype([(name, "i8" if name == "camera" else "f8") for name in NAMES])
FIXED, GIMBAL = 0, 1


def settings(
    dt=0.1, s_x=100.0, s_v=10.0, camera=GIMBAL, min_range=1e-3, sigma_range=0.3, sigma_angle=0.0
):
    """The least range is so small that its fade is lost in rounding."""
    return np.array([(dt, s_x, s_v, camera, min_range, sigma_range, sigma_angle)], SETTINGS)


def scene(seed, camera, sigma_angle):
    """A target ahead of a fixed axis or anywhere about a gimbal, and a random factor of P."""
    rng = np.random.default_rng(seed)
    X = rng.uniform(3, 60) * np.array([1.0, *rng.uniform(-1, 1, 2)])
    if camera == GIMBAL:
        X = Rotation.random(rng=rng).as_matrix() @ X
    root = rng.normal(size=(3, 3)) * rng.uniform(0.2, 5, 3)
    cfg = settings(camera=camera, sigma_angle=sigma_angle)
    return X, rng.uniform(-5, 5, 3), np.linalg.cholesky(root @ root.T), cfg


SCENES = [
    (seed, camera, sigma_angle)
    for seed in range(4)
    for camera in (FIXED, GIMBAL)
    for sigma_angle in (0.0, 0.02)
]


def attitude(x, cfg):
    """C_CN of an image of x: a gimbal has turned towards it."""
    C = np.eye(3)
    if cfg["camera"][0] == GIMBAL:
        camera_towards(x, C)
    return C


def information(x, P, S, cfg):
    """tr H' (H P H' + R)^-1 H P S P, term by term as in (4.32)."""
    C = attitude(x, cfg)
    X, Y, Z = C @ x
    H = np.array([[-Y / X, 1, 0], [-Z / X, 0, 1]]) @ C / X
    R = (cfg["sigma_range"][0] ** 2 / X**2 + cfg["sigma_angle"][0] ** 2) * np.eye(2)
    return np.trace(H.T @ np.linalg.inv(H @ P @ H.T + R) @ H @ P @ S @ P)


def slope(f, x, h):
    """Gradient by fourth-order central differences."""
    return np.array(
        [
            (8 * (f(x + e) - f(x - e)) - f(x + 2 * e) + f(x - 2 * e)) / (12 * h)
            for e in h * np.eye(len(x))
        ]
    )


def generic(T, cfg):
    """calS (4.30) and calB (4.31) from six-state matrices: Gramian and transition by `expm`."""
    eye, O = np.eye(3), np.zeros((3, 3))
    F, G = np.block([[O, eye], [O, O]]), np.vstack([O, -eye])
    dt, after = cfg["dt"][0], T - cfg["dt"][0]
    S_f = np.kron(np.diag([cfg["s_x"][0], cfg["s_v"][0]]), eye)
    van_loan = expm(after * np.block([[-F, G @ G.T], [np.zeros((6, 6)), F.T]]))
    Phi = van_loan[6:, 6:].T
    gramian = Phi @ van_loan[:6, 6:]
    inverse = np.linalg.inv(np.eye(6) + gramian @ S_f)
    Gamma = G * dt + F @ G * dt**2 / 2
    calS = Phi.T @ S_f @ gramian @ S_f @ inverse @ Phi
    calB = Gamma.T @ Phi.T @ S_f @ inverse @ Phi @ Gamma + eye * dt
    return calS[:3, :3], calB


def belief(X, V, L, T):
    """One record."""
    D = len(X)
    fields = [("rhat_TV_N", (D,)), ("chol", (D * (D + 1) // 2,)), ("v_V_N", (D,)), ("t_go", ())]
    out = np.zeros(1, [(name, "f8", shape) for name, shape in fields])
    out["rhat_TV_N"], out["chol"], out["v_V_N"], out["t_go"] = X, L[np.tril_indices(D)], V, T
    return out


def pushed(X, V, L, T, cfg):
    """The terminal law's command, and what the law adds to it."""
    terminal, commands = np.empty(len(X)), np.empty((1, len(X)))
    lq.command(X, V, T, cfg["s_x"][0], cfg["s_v"][0], terminal)
    laws()["osa"].decide(belief(X, V, L, T), cfg, commands)
    return terminal, commands[0] - terminal


@pytest.mark.parametrize(("seed", "camera", "sigma_angle"), SCENES)
@pytest.mark.parametrize("T", [0.2, 3.0, 20.0])
def test_the_push_is_the_thesis_formula_with_generic_matrices(seed, camera, sigma_angle, T):
    """(4.35) with H^T restored, matrices of six states, differentiated numerically by da."""
    X, V, L, cfg = scene(seed, camera, sigma_angle)
    calS, calB = generic(T, cfg)
    terminal, added = pushed(X, V, L, T, cfg)
    dt = cfg["dt"][0]

    def seen(da):
        return information(X - V * dt - 0.5 * (terminal + da) * dt**2, L @ L.T, calS, cfg)

    expected = 0.5 * np.linalg.solve(calB.T, slope(seen, np.zeros(3), 0.5))
    floor = 1e-15 * np.abs(terminal).max()  # the push is a difference of commands
    assert np.allclose(added, expected, rtol=0, atol=1e-6 * np.abs(expected).max() + floor)


@pytest.mark.parametrize(("seed", "camera", "sigma_angle"), SCENES)
def test_the_push_lowers_the_predicted_cost(seed, camera, sigma_angle):
    """(4.29): 1/2 tr (P^- - P) calS gained is more than 1/2 da' calB da paid, for small pushes."""
    X, V, L, cfg = scene(seed, camera, sigma_angle)
    T, dt = 10.0, cfg["dt"][0]
    calS, calB = generic(T, cfg)
    terminal, added = pushed(X, V, L, T, cfg)

    def predicted(da):
        x = X - V * dt - 0.5 * (terminal + da) * dt**2
        return 0.5 * da @ calB @ da - 0.5 * information(x, L @ L.T, calS, cfg)

    little = 1e-2 * added
    assert predicted(little) < predicted(np.zeros(3))
    assert predicted(-little) > predicted(np.zeros(3))


@pytest.mark.parametrize("camera", [FIXED, GIMBAL])
def test_the_push_is_across_the_line_of_sight(camera):
    """With noise that goes as 1/X, depth tells nothing: only a change of viewing direction does."""
    X, V, L, cfg = scene(3, camera, 0.0)
    dt = cfg["dt"][0]
    terminal, added = pushed(X, V, L, 10.0, cfg)
    sight = X - V * dt - 0.5 * terminal * dt**2
    assert np.linalg.norm(added) > 0.0
    assert abs(added @ sight) < 1e-9 * np.linalg.norm(added) * np.linalg.norm(sight)


@pytest.mark.parametrize("camera", [FIXED, GIMBAL])
def test_perfect_information_needs_no_push(camera):
    X, V, _, cfg = scene(0, camera, 0.0)
    assert np.array_equal(pushed(X, V, np.zeros((3, 3)), 10.0, cfg)[1], np.zeros(3))


@pytest.mark.parametrize("camera", [FIXED, GIMBAL])
def test_the_last_measurement_is_worth_nothing(camera):
    X, V, L, cfg = scene(0, camera, 0.0)
    assert np.array_equal(pushed(X, V, L, cfg["dt"][0], cfg)[1], np.zeros(3))


@pytest.mark.parametrize("depth", [-5.0, 0.0, 0.005])
def test_no_push_where_no_image_can_be_had(depth):
    X, V, L = np.array([depth, 1.0, 1.0]), np.zeros(3), np.eye(3)
    # hardly any terminal command, so that the vehicle stays
    cfg = settings(s_x=1e-9, s_v=0.0, camera=FIXED, min_range=0.3)
    assert np.array_equal(pushed(X, V, L, 10.0, cfg)[1], np.zeros(3))


def test_in_a_level_plane_it_is_the_law_of_two_axes():
    """Where the height is known, there is nothing to learn outside the plane of the flight."""
    X, V, L = np.array([20.0, 4.0]), np.array([3.0, -1.0]), np.array([[5.0, 0.0], [1.0, 0.4]])
    level = np.zeros((3, 3))
    level[:2, :2] = L
    cfg = settings(camera=FIXED, sigma_angle=0.01)
    flat = sum(pushed(X, V, L, 10.0, cfg))
    terminal, added = pushed(np.array([*X, 0.0]), np.array([*V, 0.0]), level, 10.0, cfg)
    assert np.allclose(terminal + added, [*flat, 0.0], rtol=1e-12)
    assert np.linalg.norm(added) > 0.1


def test_rows_are_decided_one_by_one_and_time_to_go_is_at_least_one_step():
    X, V, L, cfg = scene(2, GIMBAL, 0.0)
    rows = np.concatenate([belief(X, V, L, T) for T in (10.0, 0.1, 0.0)])
    commands, alone = np.empty((3, 3)), np.empty((1, 3))
    laws()["osa"].decide(rows, cfg, commands)
    for i in range(3):
        laws()["osa"].decide(rows[i : i + 1], cfg, alone)
        assert np.array_equal(commands[i], alone[0])
    assert np.array_equal(commands[1], commands[2])
    assert not np.array_equal(commands[0], commands[1])
