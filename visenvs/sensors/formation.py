"""A camera that looks for the centre and the wing tips of a leader: view, dropouts, noise.

The camera looks level along the follower's heading. Its image points (Y/X, Z/X) have independent
noise. The angle between the wing tips follows one of these models:

    facing   2 atan(b / (2 r)), as of a wing that faces the camera, which every filter assumes
    points   from the two noisy tips of the banked wing, by UKF paper (18)
    flat     from the same tips, by thesis (2.24), which takes the leader to be on the optical axis
    none     no tips are found: bearing only
"""

from __future__ import annotations

import math

from visenvs.core.compile import kernel
from visenvs.core.noise import normal_pair, uniform
from visenvs.core.units import GRAVITY

WINGS = ("facing", "points", "flat", "none")  # the order of the codes
FACING, POINTS, FLAT, NONE = range(len(WINGS))

CENTRE, LEFT, RIGHT, DROPOUT, DRAWS = range(5)  # what the draws of one agent are for, how many
NEAREST = 0.1  # of the depth, m


@kernel
def linked(was, cfg, seed, episode, stream, step, agent):
    """1 where the image processor holds on to the leader: a Markov chain from image to image.

    Args:
        was: whether it did at the last image.
        cfg: record with p_lose and p_regain, chances from one image to the next.
    """
    change = uniform(seed, episode, stream, step, DRAWS * agent + DROPOUT)
    holds = change >= cfg["p_lose"] if was > 0.0 else change < cfg["p_regain"]
    return 1.0 if holds else 0.0


@kernel
def in_view(r, heading, cfg):
    """Whether a point, relative in N (m), lies in the picture of a level camera."""
    c, s = math.cos(heading), math.sin(heading)
    X, Y = c * r[0] + s * r[1], c * r[1] - s * r[0]
    wide, high = math.tan(cfg["view"][0]), math.tan(cfg["view"][1])
    return X > NEAREST and abs(Y) <= wide * X and abs(r[2]) <= high * X


@kernel
def take_sight(r, heading, leader, cfg, seed, episode, stream, step, agent, sight):
    """Measure a leader that is in view.

    Args:
        r: its centre relative to the follower in N, m, (3,).
        heading: of the camera, rad.
        leader: record with v_N, a_N and wingspan; it banks as a coordinated turn wants.
        cfg: record with wings, sigma_image (of an image point).
        sight: written: u_N and alpha (0 for none).
    """
    c, s, sigma = math.cos(heading), math.sin(heading), cfg["sigma_image"]
    first = DRAWS * agent
    n_y, n_z = normal_pair(seed, episode, stream, step, first + CENTRE)
    X = max(c * r[0] + s * r[1], NEAREST)
    y = (c * r[1] - s * r[0]) / X + sigma * n_y
    z = r[2] / X + sigma * n_z
    length = math.sqrt(1.0 + y * y + z * z)
    u = sight["u_N"]
    u[0], u[1], u[2] = (c - s * y) / length, (s + c * y) / length, z / length
    if cfg["wings"] == NONE:
        sight["alpha"] = 0.0
        return
    l_y, l_z = normal_pair(seed, episode, stream, step, first + LEFT)
    r_y, r_z = normal_pair(seed, episode, stream, step, first + RIGHT)
    if cfg["wings"] == FACING:
        half = 0.5 * leader["wingspan"] / math.sqrt(r[0] * r[0] + r[1] * r[1] + r[2] * r[2])
        sight["alpha"] = max(2.0 * math.atan(half) + sigma * (r_y - l_y), 0.0)
        return
    north, east, down = half_wing(leader)
    ahead, aside = c * north + s * east, c * east - s * north
    Y = c * r[1] - s * r[0]
    near, far = max(X + ahead, NEAREST), max(X - ahead, NEAREST)
    wide = (Y + aside) / near - (Y - aside) / far + sigma * (r_y - l_y)
    high = (r[2] + down) / near - (r[2] - down) / far + sigma * (r_z - l_z)
    half = 0.5 * math.hypot(wide, high)
    sight["alpha"] = 2.0 * math.atan(half if cfg["wings"] == FLAT else half / length)


@kernel
def banked(leader):
    """The direction to its right (north, east), and how far it banks that way, rad."""
    v, a = leader["v_N"], leader["a_N"]
    speed = max(math.hypot(v[0], v[1]), 1e-3)
    north, east = -v[1] / speed, v[0] / speed
    return north, east, math.atan2(a[0] * north + a[1] * east, GRAVITY)


@kernel
def half_wing(leader):
    """From the leader's centre to its right wing tip in N, m."""
    north, east, bank = banked(leader)
    half = 0.5 * leader["wingspan"]
    return half * math.cos(bank) * north, half * math.cos(bank) * east, half * math.sin(bank)
