"""The friction pair, and the tension that a contact bears, in every scheme."""

import numpy as np
import pytest

from setups import plate, plate_scene, scene
from stickslip_reference import cycle, trace
from stickslip_reference import network as net

SCHEMES = ("geometric", "velocity")
# F_T over mu (F_N + A) at slip, less 1. Measured: 5.6e-16.
CONE_TOLERANCE = 1e-12
# Forces of the plate, whose springs are linear to about travel over their length, 1e-6. Measured: 1.0e-9.
PLATE_TOLERANCE = 2e-6
STATIC, KINETIC = 0.6, 0.3
LAWS = ("sliding", "sticking", "stick-slip")


def drag(scheme, surface="faceted", law="stick-slip", duration=0.6, **contact):
    """Pressed into a small block, dragged, and lifted again."""
    waypoints = [[0.0, -0.01, 0.0013, 0.00051], [0.1, -0.01, 0.0013, -0.003], [0.4, 0.008, 0.0013, -0.003],
                 [0.5, 0.008, 0.0013, 0.004], [0.6, 0.008, 0.0013, 0.004]]
    if law == "stick-slip":
        contact = {"friction": {"static": STATIC, "kinetic": KINETIC}} | contact
    read = scene(law, duration=duration, instrument={"waypoints": waypoints}, mesh={"nodes": [6, 6, 5]},
                 local={"model": "full"}, contact={"scheme": scheme, "surface": surface} | contact)
    result = cycle.run(read, net.block(read))
    assert result.fault is None and result.inside_without_contact == 0
    return result, trace.table(result)


@pytest.mark.parametrize("adhesion, surface", [(0.0, "faceted"), (0.2, "faceted"), (0.2, "subdivision")])
@pytest.mark.parametrize("scheme", SCHEMES)
def test_a_contact_sticks_up_to_the_static_bound_unless_it_slipped(within, scheme, adhesion, surface):
    _, columns = drag(scheme, surface, adhesion=adhesion)
    mode, ft, bearing = columns["mode"], columns["ft"], columns["fn"] + adhesion
    stick, slip = mode == "stick", mode == "slip"
    assert stick.sum() > 10 and slip.sum() > 10 and (columns["fn"][stick | slip] > -adhesion).all()
    within("F_T at slip over mu_k (F_N + A), less 1", np.abs(ft[slip] / (KINETIC * bearing[slip]) - 1.0), CONE_TOLERANCE)
    slipped = np.concatenate([[False], slip[:-1]])
    assert (ft[stick] <= np.where(slipped, KINETIC, STATIC)[stick] * bearing[stick]).all()
    assert (ft[stick & ~slipped] > KINETIC * bearing[stick & ~slipped]).any()  # the static bound is used


@pytest.mark.parametrize("scheme", SCHEMES)
def test_first_slip_is_at_the_static_bound(within, scheme):
    """A plate dragged slowly along its springs: stuck, F_T = 3 kx times the way, F_N = 3 kz depth."""
    kx, kz, depth, speed, h = 20.0, 60.0, 0.004, 0.02, 1e-3
    waypoints = [[0.0, 0, 0, 0.0005], [0.1, 0, 0, -depth], [0.2, 0, 0, -depth], [1.2, speed, 0, -depth]]
    read = plate_scene(waypoints, scheme=scheme, friction={"static": STATIC, "kinetic": KINETIC})
    columns = trace.table(cycle.run(read, plate(kx, kz, 2.0, 0.004)))
    first = int(np.flatnonzero(columns["mode"] == "slip")[0])
    way = columns["qx"][first - 1 : first + 1]
    # The velocity scheme's force is that at the tick's start, with the dampers'; the geometric scheme leaves the plate at rest.
    felt = way - speed * h + 2.0 * speed / kx if scheme == "velocity" else way
    bound = STATIC * kz * depth / kx
    assert felt[0] <= bound * (1.0 + PLATE_TOLERANCE) and felt[1] > bound * (1.0 - PLATE_TOLERANCE)
    ratio = columns["ft"][first] / columns["fn"][first]
    within("F_T at slip over mu_k (F_N + A), less 1", abs(ratio / KINETIC - 1.0), CONE_TOLERANCE)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("scheme", SCHEMES)
def test_adhesion_is_the_pull_at_which_a_plate_lets_go(within, scheme, law):
    """Lifted slowly from below its rest place, the plate pulls with 3 kz z: it comes off where that reaches A."""
    kz, adhesion, speed = 60.0, 0.3, 0.02
    waypoints = [[0.0, 0, 0, 0.0005], [0.1, 0, 0, -0.001], [0.4, 0, 0, -0.001 + 0.3 * speed]]
    options = {"friction": 0.5} if law == "stick-slip" else {}
    read = plate_scene(waypoints, law, scheme=scheme, adhesion=adhesion, **options)
    columns = trace.table(cycle.run(read, plate(kz, kz, 0.0, 0.02)))
    after = columns["tick"] > 150
    off = int(np.flatnonzero(after & (columns["mode"] == "free"))[0])
    # The velocity scheme's force is that of the tick's start; an undamped plate at constant speed needs no other.
    at = off - 1 if scheme == "velocity" else off
    pull = 3.0 * kz * columns["qz"]
    assert pull[at] >= adhesion * (1.0 - PLATE_TOLERANCE) and pull[at - 1] < adhesion * (1.0 + PLATE_TOLERANCE)
    assert columns["fn"][off - 1] < -0.9 * adhesion
    within("pull of a held plate", abs(columns["fn"][off - 1] / -pull[at - 1] - 1.0), PLATE_TOLERANCE)


@pytest.mark.parametrize("scheme", SCHEMES)
def test_infinite_adhesion_never_lets_go(scheme):
    _, columns = drag(scheme, law="sticking", adhesion=float("inf"))
    contact = columns["mode"] != "free"
    assert contact[int(contact.argmax()) :].all() and columns["fn"][-1] < 0.0
    assert (drag(scheme, law="sticking")[1]["mode"][-1]) == "free"


def test_equal_coefficients_are_one_number():
    for scheme in SCHEMES:
        one, pair = (drag(scheme, friction=friction, duration=0.3)[1] for friction in (0.4, {"static": 0.4, "kinetic": 0.4}))
        assert all((one[name] == pair[name]).all() for name in ("fx", "fy", "fz", "mode", "work"))


@pytest.mark.parametrize("scheme", (*SCHEMES, "massless"))
def test_adhesion_adds_to_the_friction_on_the_mesh(within, scheme):
    """A plate that slides steadily stands further on, by mu_k A / (3 kx)."""
    kx, adhesion, speed = 20.0, 0.3, 0.05
    waypoints = [[0.0, 0, 0, 0.0005], [0.1, 0, 0, -0.004], [1.4, 1.3 * speed, 0, -0.004]]
    places = []
    for A in (0.0, adhesion):
        read = plate_scene(waypoints, scheme=scheme, adhesion=A, friction=KINETIC)
        run = cycle.run(read, plate(kx, 60.0, 1.6, 0.02))
        assert (trace.table(run)["mode"][1100:1200] == "slip").mean() > 0.9  # at the bound, round-off may choose stick
        places.append(run.rows[1199].result.at[:3, 0].mean())
    shift = (places[1] - places[0]) / (KINETIC * adhesion / (3.0 * kx))
    within("shift of a sliding plate by adhesion, less 1", abs(shift - 1.0), 1e-5)
