"""The static stiffness of a lattice block under a spread contact, against the elastic layer that it stands for."""

import numpy as np
from scipy import sparse
from scipy.integrate import quad
from scipy.sparse.linalg import cg

from setups import scene
from stickslip_reference import local_model, spread
from stickslip_reference import network as net
from stickslip_reference.surface import Point

YOUNG, POISSON, RADIUS = 5e3, 0.25, 0.01
# Of the layer's stiffness, at 6.25 mm: the lattice is stiffer by its spacing. Measured: 0.143.
COARSENESS = 0.15


def layer(s, poisson):
    """Surface displacement of a layer bonded below, over that of a half-space, at the wave number s / depth."""
    k = 3.0 - 4.0 * poisson
    return (2 * k * np.sinh(2 * s) - 4 * s) / (2 * k * np.cosh(2 * s) + 1 + k * k + 4 * s * s) if s < 40.0 else 1.0


def hertzian_stiffness(young, poisson, a, depth):
    """F / d under the pressure sqrt(1 - r^2 / a^2), d the mean displacement with that pressure as weight.

    Hankel transforms: u(s) = 2 p(s) layer(s depth) / (E* s), p(s) ~ (sin x - x cos x) / x^3 with x = s a. On a half-space
    (5/3) E* a; E. K. Dimitriadis et al., Biophys. J. 82 (2002) give the layer's effect on another quantity, the force of a
    sphere pressed in by a given depth.
    """
    def pressure(x):
        return (np.sin(x) - x * np.cos(x)) / x**3 if x > 1e-2 else 1.0 / 3.0 - x * x / 30.0
    half_space, _ = quad(lambda x: pressure(x) ** 2, 0.0, 400.0, limit=4000)
    missing, _ = quad(lambda x: pressure(x) ** 2 * (1.0 - layer(x * depth / a, poisson)), 0.0, 40.0 * a / depth, limit=1000)
    return 5.0 / 3.0 * young / (1.0 - poisson**2) * a / (1.0 - missing / half_space)


def test_the_layers_first_order_is_that_of_dimitriadis(within):
    """Their alpha_0, a fit, is the integral of 1 - layer; for nu = 1/2 they print 1.133 = 2 / pi alpha_0."""
    for poisson in (0.25, 0.5):
        own, _ = quad(lambda s: 1.0 - layer(s, poisson), 0.0, 40.0, limit=500)
        fit = (1.2876 - 1.4678 * poisson + 1.3442 * poisson**2) / (1.0 - poisson)
        within("alpha_0 of the layer, relative", abs(fit / own - 1.0), 0.01)
    within("2 / pi alpha_0 at nu = 1/2", abs(2.0 / np.pi * fit - 1.133), 5e-4)


def lattice_stiffness(spacing, counts):
    read = scene(mesh={"nodes": counts, "spacing": spacing, "stencil": "full"},
                 material={"node_mass": 0.01, "stiffness": None, "young_modulus": YOUNG})
    network = net.block(read)
    surface = spread.FeltSurface("faceted", network.triangles, network.nodes, RADIUS)
    middle = int(np.flatnonzero((np.abs(network.nodes) < 1e-9).all(axis=1))[0])
    triangle = int(np.flatnonzero((network.triangles == middle).any(axis=1))[0])
    nodes, weights = surface.support(Point(triangle, (network.triangles[triangle] == middle).astype(float)))
    W = np.zeros_like(network.nodes)
    W[nodes, 2] = weights
    free = local_model.components(np.flatnonzero(~network.fixed))
    K = -net.jacobians(network, network.nodes, np.zeros_like(W))[0][free][:, free]
    moved, failed = cg(K, W.ravel()[free], rtol=1e-9, M=sparse.diags(1.0 / K.diagonal()))
    assert failed == 0
    return 1.0 / (W.ravel()[free] @ moved)


def test_a_lattice_approaches_the_layer(within):
    """A block of 100 x 100 x 50 mm, E = 5 kPa, pressed over a radius of 10 mm."""
    expected = hertzian_stiffness(YOUNG, POISSON, RADIUS, 0.05)
    assert abs(hertzian_stiffness(YOUNG, POISSON, RADIUS, 1e3) / (5 / 3 * YOUNG / (1 - POISSON**2) * RADIUS) - 1.0) < 1e-4
    coarse, fine = (lattice_stiffness(*each) / expected - 1.0 for each in ((0.0125, [9, 9, 5]), (0.00625, [17, 17, 9])))
    print(expected, coarse, fine)
    within("stiffness of the lattice at 6.25 mm, over the layer's, less 1", abs(fine), COARSENESS)
    assert 0.0 < fine < 0.5 * coarse
