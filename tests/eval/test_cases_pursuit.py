"""What the cases of meanders, unmodelled leaders and strings measure, on paths known in advance."""

import math

import numpy as np
import pytest

from eval.cases import _adapt, fig8, fig10, fig11, string
from eval.cases._pursuit import LOG, errors, kept, off_place, times
from visenvs.core.outcome import LOST, SUCCESS
from visenvs.core.registry import find_law
from visenvs.core.units import FOOT


def log(steps, team=1):
    out = np.zeros((steps, 1, team), LOG)
    out["flies"], out["outcome"][-1] = True, SUCCESS
    return out


def test_errors_end_with_the_flight():
    flown = log(10)
    flown["offset_F"], flown["tracking_error"] = (30.0, 1.0, 0.0), (0.0, FOOT, 0.0)
    flown["rhat_LV_F"] = 30.0 + 2 * FOOT, 1.0 + FOOT, -FOOT
    flown["flies"][6:], flown["outcome"][5:] = False, LOST
    assert errors(flown)[5, 0, 0] == pytest.approx([2.0, 0.0, -1.0])
    assert off_place(flown)[5, 0, 0] == pytest.approx([0.0, 1.0, 0.0])
    assert np.isnan(errors(flown)[6:]).all()
    assert not kept(flown)[0]
    assert times(flown)[[0, -1]] == pytest.approx([0.1, 1.0])


def test_a_flight_is_kept_if_nobody_of_the_team_is_lost():
    flown = log(3, team=2)
    assert kept(flown)[0]
    flown["outcome"][-1, 0, 1] = LOST
    assert not kept(flown)[0]


@pytest.mark.parametrize("rate", string.RATES)
def test_gains_are_read_off_a_drifting_weave(rate):
    length = string.weaving(rate, 0)["t_f"]
    flown = log(round(length / 0.1), team=5)
    t = times(flown)
    for k in range(5):
        weave = 3.0 * 0.9**k * np.sin(rate * t - 0.7 * k)
        flown["r_V_N"][:, 0, k, 0] = 22.0 * t - 18.0 * k + weave
    reach = string.amplitudes(flown, rate, 0)
    assert reach[0] == pytest.approx(3.0 * 0.9 ** np.arange(5), rel=1e-9)
    assert string.per_hop(reach) == pytest.approx([0.9])


def test_spacing_errors_leave_the_headway_out():
    flown = log(600, team=2)
    flown["v_V_F"][..., 0] = string.SPEED + 3.0
    flown["tracking_error"][..., 0] = 2.0 * 3.0 + FOOT
    assert string.spacing_errors(flown, 0, 2.0)[0] == pytest.approx([1.0, 1.0])


def test_the_weave_is_scored_over_whole_periods():
    for rate in string.RATES:
        periods = (string.weaving(rate, 0)["t_f"] - string.SETTLED) * rate / (2 * math.pi)
        assert periods == pytest.approx(round(periods))


def test_every_design_and_flight_has_a_law():
    for law, _ in (*_adapt.DESIGNS.values(), *fig8.FLIGHTS.values(), *string.DESIGNS.values()):
        assert find_law(law) is not None
    assert {fig10.BEST, fig10.PAPERS} <= set(fig10.SHOWN) <= set(_adapt.DESIGNS)


def test_a_meander_tells_the_range():
    squares = {name: fig8.late_squares(name, 6).mean() for name in ("none", "optimal_on")}
    assert squares["none"] > 20.0**2 * squares["optimal_on"]


def test_the_leader_is_kept_by_the_integrator_and_lost_without_adaptation():
    """Of a hundred flights all and none: shares that a flight or two cannot turn about."""
    quick = _adapt.MANOEUVRES["0.1"]
    none, *_ = _adapt.design_rows("x/none", "none", 6, quick)
    kept, *figures = _adapt.design_rows("x/integrator", "integrator", 6, quick)
    assert (none.id, kept.id) == ("x/none/lost", "x/integrator/lost")
    assert none.ours > 0.6 and kept.ours < 0.4
    assert len(figures) == 6
    assert fig11.CASE == "fig11"


def test_a_headway_stops_what_a_constant_spacing_lets_grow():
    gains = [string.along_rows(0.4, design, 2)[1] for design in string.DESIGNS]
    assert gains[0].id == "string/along/0.4/constant/gain"
    assert gains[0].ours > 1.2
    assert gains[1].ours < 1.0
