"""What the tests of the avoidance laws share: rows of belief, and a flight under truth."""

from types import SimpleNamespace

import numpy as np
import pytest

from visenvs.core.registry import find_law

K = 6
BELIEF = np.dtype(
    [("rhat_WV_N", "f8", 3), ("v_V_N", "f8", 3), ("t_go", "f8"), ("rhat_OV_N", "f8", 3 * K)]
    + [("r_OV_N", "f8", 3 * K), ("chol_OV", "f8", 6 * K), ("vhat_O_N", "f8", 3 * K)]
    + [(name, "f8", K) for name in ("radius_O", "valid_O", "slot_O")]
)
NUMBERS = ("dt", "a_max", "t_min", "t_critical", "s_x", "s_v", "s_time")
NUMBERS += ("sigma_range", "sigma_angle", "min_range")
SETTINGS = np.dtype([(name, "f8") for name in NUMBERS] + [("lateral", "i8"), ("camera", "i8")])


def settings(**changes):
    """One record; lengths in whatever unit the beliefs have."""
    out = np.zeros(1, SETTINGS)
    values = {"dt": 0.01, "a_max": 50.0, "t_min": 0.1, "t_critical": 5.0, "s_x": 100.0}
    values |= {"s_v": 10.0, "sigma_range": 1.0, "min_range": 1e-3, "lateral": 1} | changes
    for name, value in values.items():
        out[name] = value
    return out


def belief(waypoint, V, obstacles, radii, slots=None, velocities=None, t_go=None):
    """One row with the obstacles in the order given, all as seen from the vehicle."""
    out, n = np.zeros(1, BELIEF), len(obstacles)
    out["rhat_WV_N"], out["v_V_N"] = waypoint, V
    out["t_go"] = waypoint[0] / V[0] if t_go is None else t_go
    out["rhat_OV_N"][0, : 3 * n] = np.ravel(obstacles)
    out["r_OV_N"] = out["rhat_OV_N"]
    if velocities is not None:
        out["vhat_O_N"][0, : 3 * n] = np.ravel(velocities)
    out["radius_O"][0, :n], out["valid_O"][0, :n] = radii, 1.0
    out["slot_O"][0, :n] = range(n) if slots is None else slots
    return out


def decided(name, row, cfg, memory=None):
    """The command of a law (3,); a memory that is handed in is carried on."""
    law, commands = find_law(name), np.full((1, 3), np.nan)
    kept = () if law.memory is None else (fresh(name, cfg) if memory is None else memory,)
    law.decide(row, cfg, *kept, commands)
    return commands[0]


def fresh(name, cfg):
    memory = find_law(name).memory
    return None if memory is None else np.zeros((1, memory(cfg[0], 3)))


def fly(name, obstacles, radii, waypoint, V, cfg, velocities=None, told=True):
    """Effort, least distance to each obstacle and when, the miss, and the commands of a flight.

    It ends in the plane of the waypoint. told: whether the law knows the obstacles' velocities.
    """
    obstacles, waypoint = np.array(obstacles, float), np.array(waypoint, float)
    velocities = np.zeros_like(obstacles) if velocities is None else np.array(velocities, float)
    x, V, dt, memory = np.zeros(3), np.array(V, float), cfg["dt"][0], fresh(name, cfg)
    commands, distances, cruise = [], [], V[0]
    while waypoint[0] - x[0] > 1e-9:
        assert dt * len(commands) < 2.0 * waypoint[0] / cruise, "it does not arrive"
        O = obstacles + len(commands) * dt * velocities
        known = velocities if told else None
        left = (waypoint[0] - x[0]) / max(V[0], 0.1 * cruise)
        row = belief(waypoint - x, V, O - x, radii, velocities=known, t_go=left)
        a = decided(name, row, cfg, memory)
        x += dt * (V + 0.5 * dt * a)
        V += dt * a
        commands.append(a)
        distances.append(np.linalg.norm(O + dt * velocities - x, axis=1))
    commands, distances = np.array(commands), np.array(distances)
    return SimpleNamespace(
        effort=0.5 * dt * (commands**2).sum(),
        closest=distances.min(axis=0),
        when=dt * (distances.argmin(axis=0) + 1),
        miss=np.linalg.norm((x - waypoint)[1:]),
        commands=commands,
    )


@pytest.fixture(scope="session")
def air():
    """The helpers of this file."""
    return SimpleNamespace(settings=settings, belief=belief, decided=decided, fresh=fresh, fly=fly)
