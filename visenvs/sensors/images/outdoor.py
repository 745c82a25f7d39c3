"""Pictures of the open air: ground, clouds and haze by a ray for every pixel, and shaded balls.

The ground is a plane below and the clouds a plane above; both are read from a texture without a
seam, from the copy whose texels are about as large as the pixel's footprint. Distance fades all
into the haze by 1 / (1 + d + d^2 / 2), d the distance over the haze's length: almost exp(-d).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import numpy as np

from visenvs.core.compile import kernel
from visenvs.core.frames import rotate
from visenvs.sensors.images.optics import Image, Optics, Values
from visenvs.sensors.images.textures import packed, periodic

SIZE, LEVELS = 1024, 6
GROUND_STREAM, CLOUD_STREAM = 0, 1
WORLDS = 4  # grounds and skies that episodes take turns with
LOWEST = 1.0  # distance of the camera from ground and clouds, m
SAMPLES = 3  # rays a pixel of a ball's edge, each way
COLOURS = np.dtype([(name, "f8", (3,)) for name in ("low", "high", "sky", "cloud", "haze")])


@dataclass(frozen=True)
class Sky:
    """How the open air looks; lengths in m, colours RGB.

    Attributes:
        ground: height of the origin of N above the ground.
        ceiling: height of the clouds above the origin of N.
        ground_texel, cloud_texel: sides of a texel of the textures.
        visibility: length over which the haze takes hold.
        sun: direction to the light, N.
    """

    ground: float = 100.0
    ceiling: float = 900.0
    ground_texel: float = 0.5
    cloud_texel: float = 4.0
    visibility: float = 4000.0
    sun: tuple[float, float, float] = (-0.35, -0.4, -0.85)

    def __post_init__(self) -> None:
        lengths = (
            self.ground,
            self.ceiling,
            self.ground_texel,
            self.cloud_texel,
            self.visibility,
        )
        if not min(lengths) > 0.0:
            raise ValueError(f"all lengths must be positive, got {self}; write `Sky()`")


class Outdoor:
    """Ground and clouds of one seed, from which any camera's pictures are made."""

    def __init__(self, seed: int = 0, sky: Sky | None = None) -> None:
        self.sky = sky or Sky()
        self._ground = packed(periodic(SIZE, 1.1, seed, GROUND_STREAM), LEVELS)
        self._clouds = packed(periodic(SIZE, 1.7, seed, CLOUD_STREAM), LEVELS)
        self._colours = np.zeros(1, COLOURS)
        self._colours["low"], self._colours["high"] = (62, 78, 44), (142, 132, 92)
        self._colours["sky"], self._colours["cloud"] = (96, 146, 206), (232, 236, 240)
        self._colours["haze"] = (196, 206, 214)

    def render(self, optics: Optics, C: Values, r_V_N: Values) -> Image:
        """Ground and sky through a perfect lens, RGB, (height, width, 3).

        Args:
            optics: the camera.
            C: its attitude C_CN, (3, 3).
            r_V_N: its position, m, (3,); beyond ground or clouds it is drawn LOWEST from them.
        """
        frame, sky = np.empty((optics.height, optics.width, 3), np.uint8), self.sky
        heights = np.array([sky.ground - r_V_N[2], sky.ceiling + r_V_N[2]])
        heights = np.maximum(heights, LOWEST)
        texels = np.array([sky.ground_texel, sky.cloud_texel])
        textures, lens = (self._ground, self._clouds), (optics.focal, optics.cx, optics.cy)
        paint_background(
            frame, C, r_V_N, heights, *textures, texels, sky.visibility, self._colours[0], lens
        )
        return frame

    def balls(
        self,
        frame: Image,
        optics: Optics,
        C: Values,
        r: Values,
        radii: Values,
        colour: tuple[float, float, float],
    ) -> None:
        """Draw balls of one colour on an RGB picture, far ones first, in place.

        Args:
            frame: RGB.
            optics, C: the camera.
            r: of the centres relative to the camera, N, m, (n, 3).
            radii: m, (n,).
            colour: RGB in full light.
        """
        lens, sun = (optics.focal, optics.cx, optics.cy), np.array(self.sky.sun)
        paint, haze = np.array(colour), self._colours[0]["haze"]
        for i in np.argsort(-np.linalg.norm(r, axis=1)):
            paint_ball(frame, C, r[i], float(radii[i]), paint, sun, haze, self.sky.visibility, lens)


@cache
def shared_outdoor(seed: int, sky: Sky) -> Outdoor:
    """The ground and clouds of a seed, made once in a process and shared by all lanes."""
    return Outdoor(seed, sky)


def outdoor_of(seed: int, episode: int) -> Outdoor:
    """The ground and clouds that an episode flies between."""
    return shared_outdoor((seed + episode) % WORLDS, Sky())


@kernel
def texel(texture, north, east, footprint):
    """The texture's value at a place (texels) from the copy that suits the footprint (texels)."""
    start, side, scale = 0, SIZE, 1.0
    for _ in range(LEVELS - 1):
        if footprint * scale < 1.5:
            break
        start += side * side
        side //= 2
        scale *= 0.5
    row = math.floor(north * scale) & (side - 1)
    column = math.floor(east * scale) & (side - 1)
    return texture[start + row * side + column] * (1.0 / 255.0)


@kernel
def paint_background(frame, C, r_V, heights, ground, clouds, texels, visibility, colours, lens):
    """Fill a picture with ground, clouds and haze.

    Args:
        frame: written, (height, width, 3).
        C: camera attitude C_CN, (3, 3).
        r_V: its position, m, (3,).
        heights: above the ground, and below the clouds, m, (2,).
        ground, clouds: packed textures.
        texels: their sides, m, (2,).
        visibility: length of the haze, m.
        colours: a record of COLOURS.
        lens: focal, cx, cy, pixels.
    """
    focal, cx, cy = lens
    low, high, haze = colours["low"], colours["high"], colours["haze"]
    sky, cloud = colours["sky"], colours["cloud"]
    # products rather than quotients: they cost half of the picture
    pixel, over_ground, over_clouds = 1.0 / focal, 1.0 / texels[0], 1.0 / texels[1]
    near, far = 1.0 / visibility, 0.25 / visibility
    for v in range(frame.shape[0]):
        z = (v - cy) * pixel
        for u in range(frame.shape[1]):
            y = (u - cx) * pixel
            north = C[0, 0] + y * C[1, 0] + z * C[2, 0]
            east = C[0, 1] + y * C[1, 1] + z * C[2, 1]
            down = C[0, 2] + y * C[1, 2] + z * C[2, 2]
            below = down > 0.0
            away = max(abs(down), 1e-4)
            t = (heights[0] if below else heights[1]) / away
            over = over_ground if below else over_clouds
            footprint = t * pixel * over
            at_north, at_east = (r_V[0] + t * north) * over, (r_V[1] + t * east) * over
            d = t * (near if below else far)
            clear = 1.0 / (1.0 + d + 0.5 * d * d)
            if below:
                w = texel(ground, at_north, at_east, footprint)
            else:
                w = texel(clouds, at_north, at_east, footprint)
                w = min(max(2.0 * w - 0.6, 0.0), 1.0)
            for k in range(3):
                first, second = (low[k], high[k]) if below else (sky[k], cloud[k])
                value = first + w * (second - first)
                frame[v, u, k] = int(haze[k] + clear * (value - haze[k]))


@kernel
def extent(depth, across, radius, limit):
    """Least and largest image coordinate of a ball, by its centre's depth and offset, m."""
    square = depth * depth - radius * radius
    inside = depth * depth + across * across - radius * radius
    if square <= 0.0 or depth <= 0.0 or inside <= 0.0:
        return -limit, limit
    root = radius * math.sqrt(inside)
    return (depth * across - root) / square, (depth * across + root) / square


@kernel
def paint_ball(frame, C, r, radius, colour, sun, haze, visibility, lens):
    """Draw one shaded ball, with its edge's pixels covered in part, in place.

    Args:
        r: of its centre relative to the camera, N, m, (3,).
        radius: m.
        colour, haze: RGB, (3,).
        sun: direction to the light, N, (3,).
        visibility: length of the haze, m.
        lens: focal, cx, cy, pixels.
    """
    focal, cx, cy = lens
    X, Y, Z = rotate(C, r)
    square = X * X + Y * Y + Z * Z - radius * radius
    if X < -radius or square <= 0.0:
        return
    height, width = frame.shape[0], frame.shape[1]
    left, right = extent(X, Y, radius, 1e3)
    top, bottom = extent(X, Z, radius, 1e3)
    first, last = max(int(cx + focal * left), 0), min(int(cx + focal * right) + 1, width - 1)
    upper, lower = max(int(cy + focal * top), 0), min(int(cy + focal * bottom) + 1, height - 1)
    light = math.sqrt(sun[0] * sun[0] + sun[1] * sun[1] + sun[2] * sun[2])
    sX, sY, sZ = rotate(C, sun)
    d = math.sqrt(square) / visibility
    clear = 1.0 / (1.0 + d + 0.5 * d * d)
    step = 1.0 / SAMPLES
    # squared cosine of incidence two pixels inside the edge: one ray is enough there
    flat = min(4.0 * max(X, 0.0) / (focal * radius), 1.0) * radius * radius
    for v in range(upper, lower + 1):
        for u in range(first, last + 1):
            hits, shine, cover = 0, 0.0, step * step
            for n in range(SAMPLES * SAMPLES):
                k = (n + 4) % 9  # the middle first
                y = (u + (k % SAMPLES + 0.5) * step - 0.5 - cx) / focal
                z = (v + (k // SAMPLES + 0.5) * step - 0.5 - cy) / focal
                along = X + y * Y + z * Z
                norm = 1.0 + y * y + z * z
                root = along * along - norm * square
                if root >= 0.0 and along > 0.0:
                    hits += 1
                    t = (along - math.sqrt(root)) / norm
                    cosine = (t - X) * sX + (t * y - Y) * sY + (t * z - Z) * sZ
                    shine += 0.45 + 0.55 * max(cosine / (radius * light), 0.0)
                    if n == 0 and root > flat * norm:
                        cover = 1.0
                        break
            if hits > 0:
                cover, shine = hits * cover, shine / hits
                for k in range(3):
                    value = haze[k] + clear * (shine * colour[k] - haze[k])
                    frame[v, u, k] = int(frame[v, u, k] + cover * (value - frame[v, u, k]) + 0.5)
