"""Figure 30 of the thesis (3.5.2): two obstacles, tracks by z-test, minimum effort; in feet.

The thesis flies a simulated helicopter with an image processor; this is its point mass with image
noise of 0.01, a tenth of what the filter assumes, and the printed covariance of a new track (3.35).
`cone-meg` aims at the sphere itself, so that about 0.9 of its flights keep 0.9 d and half enter the
sphere a little, whatever the filter; judged is the separation of aiming at 1.05 d.
"""

from __future__ import annotations

from visenvs.core.units import FOOT

from . import Row
from ._avoidance import fly, mean

CASE = "fig30"
LAWS = {"meg": "cone-meg", "meg-x1.05": "cone-meg-x1.05"}
JUDGED = "meg-x1.05"


def rows(episodes: int) -> list[Row]:
    """Tracks, when the second began (s), wrong updates, separations (ft), and who keeps 0.9 d."""
    out: list[Row] = []
    for name, law in LAWS.items():
        records, at = fly("thesis-3.5.2", law, episodes), f"{CASE}/{name}"
        made, kept = records["tracks"]["made"], records["min_separation"] >= 0.9
        out.append(mean(f"{at}/two_tracks", made == 2, 1.0, 0.97))
        second = records["t_made"][made >= 2, 1]
        if len(second):
            out.append(mean(f"{at}/second_track_s", second, 4.6, 4.4, 5.0))
        out.append(mean(f"{at}/wrong_updates", records["tracks"]["wrong"], 0.0))
        for i in range(2):
            out.append(mean(f"{at}/closest_{i + 1}_ft", records["closest"][:, i] / FOOT, 100.0))
        out.append(mean(f"{at}/keeps_0.9d", kept, 1.0, 0.9 if name == JUDGED else None))
    return out
