"""P, Q, P~, Q~ built literally, against what they must be whatever the completion of T and U."""

import numpy as np
import pytest

from stickslip_reference import operators

# Inverses of well-conditioned matrices of at most 60 rows. Measured: 1.1e-15.
ROUND_OFF = 1e-12

SUPPORTS = {
    "inner": (5, [3, 0, 2], [0.2, 0.3, 0.5]),
    "edge": (4, [0, 1, 2], [0.0, 0.25, 0.75]),
    "corner": (4, [2, 1, 0], [1.0, 0.0, 0.0]),
    "one node fixed": (5, [4, 1], [0.45, 0.15]),
    "negative weight": (6, [0, 2, 4], [0.7, 0.6, -0.3]),
    "twelve nodes": (20, list(range(3, 15)), np.r_[0.3, 0.2, 0.2, 0.1, np.full(8, 0.025)]),
}
pytestmark = pytest.mark.parametrize("name", SUPPORTS)


def contact(name, seed=1):
    m, support, weights = SUPPORTS[name]
    rng = np.random.default_rng(seed)
    normal = rng.normal(size=3)
    W = np.zeros((3, 3 * m))
    for node, weight in zip(support, weights):
        W[:, 3 * node : 3 * node + 3] = weight * np.eye(3)
    return m, support, np.array(weights), normal / np.linalg.norm(normal), W, rng


def apart(a, b):
    return np.abs(a - b).max() / max(1.0, np.abs(b).max())


def operators_apart(one, other):
    return [apart(getattr(one, name), getattr(other, name)) for name in ("P", "Q", "Pt", "Qt")]


def test_T_is_orthogonal_and_gives_the_contact_point(within, name):
    m, support, weights, _, W, rng = contact(name)
    T = operators.transform_T(m, support, weights)
    products = T @ T.T
    within("rows of T orthogonal (7)", apart(products, np.diag(np.diag(products))), ROUND_OFF)
    x = rng.normal(size=3 * m)
    within("T x begins with p (9)", apart((T @ x)[:3], W @ x), ROUND_OFF)


def test_literal_operators_have_the_closed_form(within, name):
    m, support, weights, normal, W, _ = contact(name)
    ops = operators.literal(m, support, weights, normal)
    s, identity, Wn = (weights**2).sum(), np.eye(3 * m), W.T @ normal
    within("P = I - W^T W / s", apart(ops.P, identity - W.T @ W / s), ROUND_OFF)
    within("Q = I - (W^T n)(W^T n)^T / s", apart(ops.Q, identity - np.outer(Wn, Wn) / s), ROUND_OFF)


@pytest.mark.parametrize("with_mass", [False, True])
def test_identities(within, name, with_mass):
    m, support, weights, normal, W, rng = contact(name)
    mass = rng.uniform(0.1, 10.0, m) if with_mass else None
    ops = operators.literal(m, support, weights, normal, mass)
    identity = np.eye(3 * m)
    within("P P = P, Q Q = Q", [apart(ops.P @ ops.P, ops.P), apart(ops.Q @ ops.Q, ops.Q)], ROUND_OFF)
    within("P Q = Q P = P", [apart(ops.P @ ops.Q, ops.P), apart(ops.Q @ ops.P, ops.P)], ROUND_OFF)
    within("P~ = I - P^T", apart(ops.Pt, identity - ops.P.T), ROUND_OFF)
    within("Q~ = I - Q^T", apart(ops.Qt, identity - ops.Q.T), ROUND_OFF)
    within("W P = 0, n^T W Q = 0", [np.abs(W @ ops.P).max(), np.abs(normal @ W @ ops.Q).max()], ROUND_OFF)
    # Traces of projectors: three directions are taken out by P, one by Q, and nothing else.
    assert round(np.trace(ops.P)) == 3 * m - 3 and round(np.trace(ops.Q)) == 3 * m - 1


def test_operators_do_not_depend_on_the_completion(within, name):
    m, support, weights, normal, _, rng = contact(name)
    size = 3 * len(support)
    candidates = rng.normal(size=(3 * size, size))
    # Other matrices T, so that equal operators say something.
    assert apart(operators.transform_T(m, support, weights), operators.transform_T(m, support, weights, candidates)) > 0.1
    plain = operators.literal(m, support, weights, normal)
    other = operators.literal(m, support, weights, normal, candidates=candidates)
    within("operators of two completions", operators_apart(plain, other), ROUND_OFF)


def test_support_block_is_the_whole_operator(within, name):
    """(8): T is the identity outside the support, so a tick needs the support's block only."""
    m, support, weights, normal, _, _ = contact(name)
    whole = operators.literal(m, support, weights, normal)
    block = operators.literal(len(support), np.arange(len(support)), weights, normal)
    columns = (3 * np.array(support)[:, None] + np.arange(3)).ravel()
    for name_of, outside in (("P", np.eye(3 * m)), ("Q", np.eye(3 * m)), ("Pt", np.zeros((3 * m, 3 * m)))):
        outside[np.ix_(columns, columns)] = getattr(block, name_of)
        within("operator of the support in the whole one", apart(getattr(whole, name_of), outside), ROUND_OFF)


def test_mass_metric_is_the_lagrange_multiplier(within, name):
    """P M^-1 f is the constrained acceleration: with lambda from W a = 0 and M a = f - W^T lambda."""
    m, support, weights, normal, W, rng = contact(name)
    mass = rng.uniform(0.1, 10.0, m)
    f = rng.normal(size=3 * m)
    M = np.diag(np.repeat(mass, 3))
    saddle = np.block([[M, W.T], [W, np.zeros((3, 3))]])
    solution = np.linalg.solve(saddle, np.concatenate([f, np.zeros(3)]))
    ops = operators.literal(m, support, weights, normal, mass)
    within("mass metric, acceleration", apart(ops.P @ np.linalg.solve(M, f), solution[: 3 * m]), ROUND_OFF)
    within("mass metric, multiplier", apart(operators.contact_force(ops.Pt, weights, f), solution[3 * m :]), ROUND_OFF)
    # The Euclidean force is another one as soon as two nodes share the load.
    euclidean = operators.contact_force(operators.literal(m, support, weights, normal).Pt, weights, f)
    assert name == "corner" or apart(euclidean, solution[3 * m :]) > 1e-3


def test_equal_masses_make_the_metrics_equal(within, name):
    m, support, weights, normal, _, _ = contact(name)
    plain = operators.literal(m, support, weights, normal)
    massive = operators.literal(m, support, weights, normal, np.full(m, 0.01))
    within("metrics at equal masses", operators_apart(plain, massive), ROUND_OFF)


def test_contact_force_and_its_normal_part(within, name):
    m, support, weights, normal, W, rng = contact(name)
    f = rng.normal(size=3 * m)
    ops = operators.literal(m, support, weights, normal)
    multiplier = operators.contact_force(ops.Pt, weights, f)
    within("lambda = sum w f / s (14)", apart(multiplier, W @ f / (weights**2).sum()), ROUND_OFF)
    along = operators.contact_force(ops.Qt, weights, f)
    within("sliding force is lambda's normal part (22)", apart(along, (multiplier @ normal) * normal), ROUND_OFF)
    # The paper's own sum (14) differs from it by the weight of the free nodes.
    within("sum of node forces (14)", apart((ops.Pt @ f).reshape(-1, 3).sum(axis=0), multiplier * weights.sum()), ROUND_OFF)


def test_only_the_mass_metric_never_raises_kinetic_energy(within, name):
    """With unequal masses the Euclidean P can add kinetic energy; the mass-orthogonal one cannot."""
    m, support, weights, normal, _, rng = contact(name)
    mass = rng.uniform(0.1, 10.0, m)
    root = np.sqrt(np.repeat(mass, 3))
    gain = {metric: np.linalg.norm(root[:, None] * operators.literal(m, support, weights, normal, given).P / root, 2)
            for metric, given in (("euclidean", None), ("mass", mass))}
    within("largest gain of speed by P, mass metric, less 1", gain["mass"] - 1.0, ROUND_OFF)
    assert name == "corner" or gain["euclidean"] > 1.0001
