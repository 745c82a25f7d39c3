"""The one-step-ahead push against the thesis's matrices and central differences."""

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from visenvs.core.frames import camera_towards
from visenvs.core.registry import laws
from visenvs.guidance import lq
from visenvs.guidance.osa import SCRATCH, covariance, information_gradient, push

pytestmark = pytest.mark.kernel

NAMES = ("dt", "s_x", "s_v", "camera", "min_range", "sigma_range", "sigma_angle")
SETTINGS = np.dtype([(name, "i8" if name == "camera" else "f8") for name in NAMES])
BELIEF = np.dtype(
    [("rhat_TV_N", "f8", (3,)), ("chol", "f8", (6,)), ("v_V_N", "f8", (3,)), ("t_go", "f8")]
)


def settings(
    dt=0.1, s_x=100.0, s_v=10.0, camera=1, min_range=0.3, sigma_range=0.3, sigma_angle=0.0
):
    return np.array([(dt, s_x, s_v, camera, min_range, sigma_range, sigma_angle)], SETTINGS)


def scene(seed, sigma_angle):
    """A target within 45 degrees of the optical axis, a random attitude and a random covariance."""
    rng = np.random.default_rng(seed)
    C = np.ascontiguousarray(Rotation.random(rng=rng).as_matrix())
    X = C.T @ (rng.uniform(3, 60) * np.array([1.0, *rng.uniform(-1, 1, 2)]))
    root = rng.normal(size=(3, 3)) * rng.uniform(0.2, 5, 3)
    return X, rng.uniform(-5, 5, 3), root @ root.T, C, settings(sigma_angle=sigma_angle)


SCENES = [(seed, sigma_angle) for seed in range(8) for sigma_angle in (0.0, 0.02)]


def information(x, C, P, cfg, S=None):
    """tr H' (H P H' + R)^-1 H P S P, term by term as in (4.32); S = I where not given."""
    X, Y, Z = C @ x
    H = np.array([[-Y / X, 1, 0], [-Z / X, 0, 1]]) @ C / X
    R = (cfg["sigma_range"][0] ** 2 / X**2 + cfg["sigma_angle"][0] ** 2) * np.eye(2)
    return np.trace(
        H.T @ np.linalg.inv(H @ P @ H.T + R) @ H @ P @ (np.eye(3) if S is None else S) @ P
    )


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
    return calS, calB


def pushed(X, V, P, C, T, cfg):
    """The terminal law's command and the push that is added to it."""
    a = np.empty(3)
    lq.command(X, V, T, cfg["s_x"][0], cfg["s_v"][0], a)
    terminal = a.copy()
    push(X, V, P, C, T, cfg[0], np.zeros(1, SCRATCH)[0], a)
    return terminal, a - terminal


@pytest.mark.parametrize(("seed", "sigma_angle"), SCENES)
def test_value_and_gradient_of_the_information(seed, sigma_angle):
    X, _, P, C, cfg = scene(seed, sigma_angle)
    gradient = np.empty(3)
    sigmas = cfg["sigma_range"][0], cfg["sigma_angle"][0]
    value = information_gradient(
        X, P, C, cfg["min_range"][0], *sigmas, np.zeros(1, SCRATCH)[0], gradient
    )
    assert value == pytest.approx(information(X, C, P, cfg), rel=1e-10)
    numeric = slope(lambda x: information(x, C, P, cfg), X, 1e-3)
    assert np.allclose(gradient, numeric, rtol=0, atol=1e-7 * np.abs(numeric).max())


@pytest.mark.parametrize(("seed", "sigma_angle"), SCENES)
@pytest.mark.parametrize("T", [0.2, 3.0, 20.0])
def test_the_push_is_the_thesis_formula_with_generic_matrices(seed, sigma_angle, T):
    """(4.35) with H^T restored, matrices of six states, differentiated numerically by da."""
    X, V, P, C, cfg = scene(seed, sigma_angle)
    calS, calB = generic(T, cfg)
    terminal, added = pushed(X, V, P, C, T, cfg)
    dt = cfg["dt"][0]

    def seen(da):
        x = X - V * dt - 0.5 * (terminal + da) * dt**2
        return information(x, C, P, cfg, calS[:3, :3])

    expected = 0.5 * np.linalg.solve(calB.T, slope(seen, np.zeros(3), 0.5))
    assert np.allclose(added, expected, rtol=0, atol=1e-6 * np.abs(expected).max())


@pytest.mark.parametrize(("seed", "sigma_angle"), SCENES)
def test_the_push_lowers_the_predicted_cost(seed, sigma_angle):
    """(4.29): 1/2 tr (P^- - P) calS gained is more than 1/2 da' calB da paid, for small pushes."""
    X, V, P, C, cfg = scene(seed, sigma_angle)
    T, dt = 10.0, cfg["dt"][0]
    calS, calB = generic(T, cfg)
    terminal, added = pushed(X, V, P, C, T, cfg)

    def predicted(da):
        x = X - V * dt - 0.5 * (terminal + da) * dt**2
        return 0.5 * da @ calB @ da - 0.5 * information(x, C, P, cfg, calS[:3, :3])

    little = 1e-2 * added
    assert predicted(little) < predicted(np.zeros(3))
    assert predicted(-little) > predicted(np.zeros(3))


def test_the_push_is_across_the_line_of_sight():
    """With noise that goes as 1/X, depth tells nothing: only a change of viewing direction does."""
    X, V, P, C, cfg = scene(3, 0.0)
    dt = cfg["dt"][0]
    terminal, added = pushed(X, V, P, C, 10.0, cfg)
    sight = X - V * dt - 0.5 * terminal * dt**2
    assert abs(added @ sight) < 1e-9 * np.linalg.norm(added) * np.linalg.norm(sight)


def test_perfect_information_needs_no_push():
    X, V, _, C, cfg = scene(0, 0.0)
    assert np.array_equal(pushed(X, V, np.zeros((3, 3)), C, 10.0, cfg)[1], np.zeros(3))


def test_the_last_measurement_is_worth_nothing():
    X, V, P, C, cfg = scene(0, 0.0)
    assert np.array_equal(pushed(X, V, P, C, cfg["dt"][0], cfg)[1], np.zeros(3))


@pytest.mark.parametrize("depth", [-5.0, 0.0, 0.2])
def test_no_push_where_no_image_can_be_had(depth):
    X, V, P = np.array([depth, 1.0, 1.0]), np.zeros(3), np.eye(3)
    cfg = settings(s_x=1e-9, s_v=0.0)  # hardly any terminal command, so that the vehicle stays
    assert np.array_equal(pushed(X, V, P, np.eye(3), 10.0, cfg)[1], np.zeros(3))


def test_covariance_from_the_row():
    root = np.tril(np.random.default_rng(0).normal(size=(3, 3)))
    P = np.empty((3, 3))
    covariance(root[np.tril_indices(3)], P)
    assert np.allclose(P, root @ root.T, rtol=1e-14)
    assert np.array_equal(P, P.T)


@pytest.mark.parametrize("camera", [0, 1])
def test_the_law_reads_belief_and_camera(camera):
    X, V, P, _, _ = scene(5, 0.0)
    X = np.abs(X)
    cfg, belief, commands = settings(camera=camera), np.zeros(1, BELIEF), np.zeros((1, 3))
    belief["rhat_TV_N"], belief["v_V_N"], belief["t_go"] = X, V, 10.0
    belief["chol"] = np.linalg.cholesky(P)[np.tril_indices(3)]
    laws()["osa"].decide(belief, cfg, commands)
    C = np.eye(3)
    if camera == 1:
        camera_towards(X, C)
    terminal, added = pushed(X, V, P, C, 10.0, cfg)
    assert np.linalg.norm(added) > 0.0
    assert np.allclose(commands[0], terminal + added, rtol=1e-9)
