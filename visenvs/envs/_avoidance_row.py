"""The row of an avoidance task: the waypoint, and the tracks in the order of their time to go."""

from __future__ import annotations

import math

from visenvs.core.compile import kernel
from visenvs.core.layout import Field, Layout
from visenvs.envs._avoidance_config import CONES, MOVING, K
from visenvs.envs._avoidance_sightings import GOAL, relative
from visenvs.estimation.ekf import factorise, pack_lower
from visenvs.guidance.collision_cone import coordinates, dot, tangents, time_to

FAR, SPREAD = 2000.0, 500.0  # bounds of positions and of their deviations in the row, m
OBSERVATION = Layout(
    (
        Field("rhat_WV_N", 3, "m", "N", -FAR, FAR, 100.0, "waypoint relative to the vehicle"),
        Field("v_V_N", 3, "m/s", "N", -200.0, 200.0, 10.0, "own velocity"),
        Field("t_go", 1, "s", "", 0.0, 1000.0, 20.0, "time to go to the waypoint's plane"),
        Field(
            "rhat_OV_N",
            3 * K,
            "m",
            "N",
            -FAR,
            FAR,
            100.0,
            f"estimated positions of {K} obstacles relative to the vehicle, in the order of time "
            "to go, those behind it last, zeros where there is none",
            each=K,
        ),
        Field(
            "chol_OV",
            6 * K,
            "m",
            "N",
            -SPREAD,
            SPREAD,
            10.0,
            "lower Cholesky factors of their covariances, row by row",
            each=K,
        ),
        Field("vhat_O_N", 3 * K, "m/s", "N", -50.0, 50.0, 5.0, "estimated velocities of these", K),
        Field("radius_O", K, "m", "", 0.0, 500.0, 20.0, "radii of their safety spheres", K),
        Field("valid_O", K, "", "", 0.0, 1.0, 1.0, "1 where there is an obstacle", K),
        Field("slot_O", K, "", "", 0.0, K, 8.0, "which track it is, whatever its place", K),
    )
)
TOLD_TOO = Layout(
    (
        # in front, lest Numba take such a row for one of the other kind
        Field(
            "r_OV_N", 3 * K, "m", "N", -FAR, FAR, 100.0, "true positions of the obstacles below", K
        ),
        *OBSERVATION.fields,
    )
)
FARTHEST = 1000.0  # bound of times in the row, s
CONE_TOO = Layout(
    (
        Field(
            "pass_O_N",
            3 * K,
            "m",
            "N",
            -FAR,
            FAR,
            20.0,
            "where the obstacles below will be, relative to the vehicle, when they are nearest if "
            "nothing is commanded; where they are if that is over",
            K,
        ),
        Field("t_pass_O", K, "s", "", 0.0, FARTHEST, 5.0, "time until then, 0 if it is over", K),
        Field("gap_O", K, "m", "", -FAR, FAR, 10.0, "distance from their safety spheres then", K),
        Field("sigma_gap_O", K, "m", "", 0.0, SPREAD, 5.0, "its standard deviation", K),
        Field(
            "aim_O_N",
            3 * K,
            "m",
            "N",
            -FAR,
            FAR,
            50.0,
            "aiming points of the collision cones (3.21), zeros where there is none",
            K,
        ),
        Field("t_aim_O", K, "s", "", -FARTHEST, FARTHEST, 5.0, "time to go to these (3.22)", K),
        *OBSERVATION.fields,
    )
)


@kernel
def tell(lane, cfg, work):
    """Write the row: the waypoint, and the tracks in the order of their time to go."""
    T, v, key, order, count = lane["tracks"], lane["v_V_N"], work["key"], work["order"], 0
    relative(lane, GOAL, cfg, lane["rhat_WV_N"])
    square = max(v[0] * v[0] + v[1] * v[1] + v[2] * v[2], 1e-9)
    for j in range(K + 1):
        if T["alive"][j] == 0.0:
            continue
        r = T["r"][j]
        if T["owner"][j] == GOAL:
            for i in range(3):
                lane["rhat_WV_N"][i] = r[i]
            continue
        t = (r[0] * v[0] + r[1] * v[1] + r[2] * v[2]) / square
        t = t if t >= 0.0 else 1e9 - t
        k = count
        while k > 0 and key[k - 1] > t:
            if k < K:
                key[k], order[k] = key[k - 1], order[k - 1]
            k -= 1
        if k < K:
            key[k], order[k] = t, j
        count = min(count + 1, K)
    # never slower than a tenth of the speed at the start, so that the time stays finite
    lane["t_go"] = lane["rhat_WV_N"][0] / max(v[0], 0.1 * lane["speed"])
    for k in range(K):
        write_track(lane, k, order[k] if k < count else -1, cfg)
        if cfg["observation"] == CONES:
            write_cone(lane, k, order[k] if k < count else -1, cfg, work["cone"])


@kernel
def write_track(lane, k, j, cfg):
    """Write track j into place k of the row, or zeros for j = -1."""
    T, there = lane["tracks"], 1.0 if j >= 0 else 0.0
    for i in range(3):
        lane["rhat_OV_N"][k, i] = lane["r_OV_N"][k, i] = T["r"][j, i] if j >= 0 else 0.0
        lane["vhat_O_N"][k, i] = lane["x_O"][j, i + 3] if j >= 0 else 0.0
    if j >= 0 and T["owner"][j] >= 0.0:
        relative(lane, int(T["owner"][j]), cfg, lane["r_OV_N"][k])
    lane["chol_OV"][k, :] = 0.0
    lane["valid_O"][k], lane["slot_O"][k], lane["radius_O"][k] = there, max(j, 0), 0.0
    if j >= 0:
        pack_lower(T["cov"][j], lane["chol_OV"][k])
        factorise(lane["chol_OV"][k], 3)
        lane["radius_O"][k] = lane["radius"][max(int(T["owner"][j]), 0)]


@kernel
def write_cone(lane, k, j, cfg, scratch):
    """Write how the vehicle will pass track j, and its aiming point, to place k; zeros for -1."""
    X, radius, W = lane["rhat_OV_N"][k], lane["radius_O"][k], scratch[0]
    p, aim = lane["pass_O_N"][k], lane["aim_O_N"][k]
    for i in range(3):
        W[i] = lane["v_V_N"][i] - lane["vhat_O_N"][k, i]
        p[i] = aim[i] = 0.0
    lane["t_pass_O"][k] = lane["gap_O"][k] = lane["sigma_gap_O"][k] = lane["t_aim_O"][k] = 0.0
    if j < 0:
        return
    t = min(max(dot(X, W) / max(dot(W, W), 1e-9), 0.0), FARTHEST)
    for i in range(3):
        p[i] = X[i] - t * W[i]
    distance = math.sqrt(dot(p, p))
    lane["t_pass_O"][k], lane["gap_O"][k] = t, distance - radius
    lane["sigma_gap_O"][k] = spread(lane, j, t, p, distance, cfg)
    c = coordinates(X, W, radius)[0]
    if t > 0.0 and 0.0 < c < math.inf:
        tangents(X, W, radius, c, aim, scratch[1])
        lane["t_aim_O"][k] = time_to(aim, W, cfg["lateral"] != 0)


@kernel
def spread(lane, j, t, p, distance, cfg):
    """Standard deviation, m, of the distance of track j in t s, along its position p then (3,)."""
    if distance == 0.0:
        return 0.0
    P, cov, variance = lane["P_O"][j], lane["tracks"]["cov"][j], 0.0
    for i in range(3):
        for m in range(3):
            entry = cov[i, m]
            if cfg["estimator"] == MOVING:
                entry += t * (P[i, m + 3] + P[i + 3, m] + t * P[i + 3, m + 3])
            variance += p[i] * p[m] * entry
    return math.sqrt(max(variance, 0.0)) / distance
