"""Scenes to map: a pyramid, a square frame, grid terrain, and a random town. NED, ground at z = 0.

Boxes have a flat roof, gabled houses a ridge; both stand on the ground. Every scene is drawn from
the lane's seed and episode.
"""

from __future__ import annotations

import math

from visenvs.core.compile import kernel
from visenvs.core.noise import uniform, uniform_pair

KINDS = ("town", "pyramid", "frame", "terrain")  # the order of the codes
TOWN, PYRAMID, FRAME, TERRAIN = range(4)
TRIES = 40  # places that are drawn for a house before it is left out
HOUSE_DRAWS = 8 + TRIES
STREET = 3.0  # least distance between the circles about two houses, m


@kernel
def build(scene, cfg, seed, episode, stream):
    """Write the scene of an episode into a zeroed record.

    Args:
        scene: a record with `sensors.segments.scene_columns`.
        cfg: record with scene, base, height, spacing (m), points, area (m), houses (least, most),
            side, wall and roof (ranges, m).
    """
    if cfg["scene"] == PYRAMID:
        add_pyramid(scene, 0.5 * cfg["base"], cfg["height"])
    elif cfg["scene"] == FRAME:
        add_frame(scene, 0.5 * cfg["base"], cfg["height"])
    elif cfg["scene"] == TERRAIN:
        add_terrain(scene, cfg, seed, episode, stream)
    else:
        add_town(scene, cfg, seed, episode, stream)


@kernel
def add_edge(scene, a, b, solid, first, second):
    """Add an edge between two points (north, east, down), beside two faces of a solid."""
    e = scene["edges"]
    for j in range(3):
        scene["edge"][e, j], scene["edge"][e, j + 3] = a[j], b[j]
    scene["solid"][e] = solid
    scene["face"][e, 0], scene["face"][e, 1] = first, second
    scene["edges"] += 1


@kernel
def add_face(scene, solid, normal, point):
    """Add a face through a point of a solid, with its outward normal, of any length."""
    k = scene["faces"][solid]
    length = math.sqrt(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2)
    offset = 0.0
    for j in range(3):
        scene["plane"][solid, k, j] = normal[j] / length
        offset += normal[j] * point[j] / length
    scene["plane"][solid, k, 3] = offset
    scene["faces"][solid] += 1


@kernel
def square(half, k, down):
    """Corner k of a square about the origin, clockwise from north-east."""
    north = half if k % 4 in (0, 3) else -half
    east = half if k % 4 in (0, 1) else -half
    return north, east, down


@kernel
def add_pyramid(scene, half, height):
    """A square pyramid: four edges on the ground, four to the top."""
    top = (0.0, 0.0, -height)
    scene["solids"] = 1
    for k in range(4):
        a, b = square(half, k, 0.0), square(half, k + 1, 0.0)
        add_edge(scene, a, b, 0, k, k)
        add_edge(scene, a, top, 0, k, (k + 3) % 4)
        out = (a[0] + b[0], a[1] + b[1])
        reach = math.hypot(out[0], out[1])
        add_face(scene, 0, (out[0] / reach, out[1] / reach, -half / height), a)


@kernel
def add_frame(scene, half, height):
    """Four edges of a level square, held above the ground."""
    for k in range(4):
        add_edge(scene, square(half, k, -height), square(half, k + 1, -height), -1, -1, -1)


@kernel
def grid_point(cfg, i, j, seed, episode, stream):
    """Point of row i and column j of the terrain, with a drawn height."""
    n = cfg["points"]
    half = 0.5 * (n - 1) * cfg["spacing"]
    height = cfg["height"] * uniform(seed, episode, stream, 0, i * n + j)
    return i * cfg["spacing"] - half, j * cfg["spacing"] - half, -height


@kernel
def add_terrain(scene, cfg, seed, episode, stream):
    """Edges between neighbours of a square grid of points, first all to the east of a point."""
    n = cfg["points"]
    for i in range(n):
        for j in range(n):
            here = grid_point(cfg, i, j, seed, episode, stream)
            if j + 1 < n:
                east = grid_point(cfg, i, j + 1, seed, episode, stream)
                add_edge(scene, here, east, -1, -1, -1)
            if i + 1 < n:
                north = grid_point(cfg, i + 1, j, seed, episode, stream)
                add_edge(scene, here, north, -1, -1, -1)


@kernel
def add_town(scene, cfg, seed, episode, stream):
    """Houses apart from each other, each a box or with a gable, in a square of half side `area`."""
    least, most = cfg["houses"][0], cfg["houses"][1]
    wanted = int(least + (most - least + 1.0) * uniform(seed, episode, stream, 0, 0))
    for h in range(wanted):
        first = 1 + HOUSE_DRAWS * h
        u, v = uniform_pair(seed, episode, stream, 0, first)
        long = 0.5 * (cfg["side"][0] + u * (cfg["side"][1] - cfg["side"][0]))
        wide = 0.5 * (cfg["side"][0] + v * (cfg["side"][1] - cfg["side"][0]))
        u, v = uniform_pair(seed, episode, stream, 0, first + 1)
        wall = cfg["wall"][0] + u * (cfg["wall"][1] - cfg["wall"][0])
        rise = cfg["roof"][0] + v * (cfg["roof"][1] - cfg["roof"][0])
        u, v = uniform_pair(seed, episode, stream, 0, first + 2)
        reach = math.hypot(long, wide)
        room = cfg["area"] - reach
        for k in range(TRIES):
            x, y = uniform_pair(seed, episode, stream, 0, first + 3 + k)
            x, y = (2.0 * x - 1.0) * room, (2.0 * y - 1.0) * room
            if apart(scene, x, y, reach):
                pose = (x, y, math.cos(math.pi * u), math.sin(math.pi * u))
                add_house(scene, pose, long, wide, wall, rise if v < 0.5 else 0.0)
                break


@kernel
def apart(scene, x, y, reach):
    """Whether a circle keeps STREET clear of those about the houses that stand already.

    A wall's plane n x <= b through a footprint tells where the opposite one is: the walls of a pair
    have opposite normals, and their offsets add up to the house's width.
    """
    for b in range(scene["solids"]):
        square, north, east = 0.0, 0.0, 0.0
        for k in range(2):
            n, other = scene["plane"][b, k], scene["plane"][b, k + 2]
            square += (0.5 * (n[3] + other[3])) ** 2
            north += 0.5 * (n[3] - other[3]) * n[0]
            east += 0.5 * (n[3] - other[3]) * n[1]
        if math.hypot(x - north, y - east) < reach + math.sqrt(square) + STREET:
            return False
    return True


@kernel
def place(pose, ahead, right, up):
    """Point of a house (north, east, down), from its own axes.

    Args:
        pose: north and east of its middle, m, cosine and sine of its heading.
    """
    x, y, c, s = pose
    return x + c * ahead - s * right, y + s * ahead + c * right, -up


@kernel
def corner(pose, long, wide, k, up):
    """Corner k of a footprint, clockwise from ahead on the right, at a height."""
    ahead = long if k % 4 in (0, 3) else -long
    right = wide if k % 4 in (0, 1) else -wide
    return place(pose, ahead, right, up)


@kernel
def add_house(scene, pose, long, wide, wall, rise):
    """A house with a flat roof, or with a ridge `rise` above its walls along its heading.

    Face k < 4 is the wall from corner k to the next one; 4 and 5 are roofs.
    """
    solid, c, s = scene["solids"], pose[2], pose[3]
    scene["solids"] += 1
    for k in range(4):
        foot, top = corner(pose, long, wide, k, 0.0), corner(pose, long, wide, k, wall)
        ahead, right = (0.0, -1.0, 0.0, 1.0)[k], (1.0, 0.0, -1.0, 0.0)[k]
        add_face(scene, solid, (c * ahead - s * right, s * ahead + c * right, 0.0), foot)
        add_edge(scene, foot, corner(pose, long, wide, k + 1, 0.0), solid, k, k)
        add_edge(scene, foot, top, solid, k, (k + 3) % 4)
        roof = 4 if k < 2 or rise == 0.0 else 5
        if rise == 0.0 or k % 2 == 0:
            add_edge(scene, top, corner(pose, long, wide, k + 1, wall), solid, k, roof)
    if rise == 0.0:
        add_face(scene, solid, (0.0, 0.0, -1.0), corner(pose, long, wide, 0, wall))
        return
    front, back = place(pose, long, 0.0, wall + rise), place(pose, -long, 0.0, wall + rise)
    add_edge(scene, front, back, solid, 4, 5)
    for k in range(4):
        top, side = corner(pose, long, wide, k, wall), (1.0 if k < 2 else -1.0)
        gable = 3 if k % 4 in (0, 3) else 1
        add_edge(scene, top, front if gable == 3 else back, solid, gable, 4 if k < 2 else 5)
        if k % 2 == 0:  # corner 0 lies on roof 4, corner 2 on roof 5
            add_face(scene, solid, (-s * side * rise, c * side * rise, -wide), top)
