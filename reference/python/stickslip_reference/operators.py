"""The paper's constraint operators P, Q, P~, Q~ (7)-(22), built literally through T and U, and the contact force."""

from dataclasses import dataclass

import numpy as np

# A candidate row whose remainder is shorter than this is dependent on the rows before it: Gram-Schmidt skips it.
DEPENDENT = 1e-3


@dataclass(frozen=True)
class Operators:
    """P, Q act on velocities, Pt, Qt (P~, Q~) on forces; all (3m, 3m)."""

    P: np.ndarray
    Q: np.ndarray
    Pt: np.ndarray
    Qt: np.ndarray


def complete(rows, candidates):
    """Gram-Schmidt: orthogonal square matrix that begins with `rows` (orthogonal, left unnormalised) (7), (16)."""
    count = len(rows)
    basis, squares = np.empty((rows.shape[1], rows.shape[1])), np.empty(rows.shape[1])
    basis[:count], squares[:count] = rows, (rows * rows).sum(axis=1)
    for candidate in candidates:
        if count == len(basis):
            break
        scale = np.linalg.norm(candidate)
        for _ in range(2):  # the second pass removes what round-off left of the first
            done = basis[:count]
            candidate = candidate - ((done @ candidate) / squares[:count]) @ done
        length = np.linalg.norm(candidate)
        if length > DEPENDENT * scale:
            basis[count], squares[count] = candidate / length, 1.0
            count += 1
    return basis[:count]


def transform_T(m, support, weights, candidates=None):
    """T of (7)-(8) for a contact on the nodes `support` of an m-node model. Returns (3m, 3m)."""
    k = len(support)
    weights = np.asarray(weights)[None, :]
    if candidates is None:  # unit vectors: the three axes do not mix
        T11 = np.kron(complete(weights, np.eye(k)), np.eye(3))
    else:
        T11 = complete(np.kron(weights, np.eye(3)), candidates)
    columns = (3 * np.asarray(support)[:, None] + np.arange(3)).ravel()
    others = np.setdiff1d(np.arange(3 * m), columns)
    T = np.zeros((3 * m, 3 * m))
    T[: 3 * k, columns] = T11
    T[np.arange(3 * k, 3 * m), others] = 1.0
    return T


def transform_U(T, normal):
    """U of (16)-(18): the first three rows of T turned so that the very first one points along the normal."""
    U = T.copy()
    U[:3] = complete(np.asarray(normal)[None, :], np.eye(3)) @ T[:3]
    return U


def literal(m, support, weights, normal, mass=None, candidates=None):
    """P, Q, P~, Q~ by (10), (13), (19), (21).

    With `mass` (m,) they are the projectors orthogonal in the mass inner product: the same construction in the
    coordinates M^(1/2) v, where that product is the plain one. P~ = I - P^T and Q~ = I - Q^T hold in both.
    """
    support = np.asarray(support)
    root = np.ones(m) if mass is None else np.sqrt(mass)
    T = transform_T(m, support, np.asarray(weights) / root[support], candidates)
    U = transform_U(T, normal)
    scale = np.repeat(root, 3)
    (P, Pt), (Q, Qt) = projections(T, 3), projections(U, 1)
    inner, outer = scale / scale[:, None], scale[:, None] / scale
    return Operators(P * inner, Q * inner, Pt * outer, Qt * outer)


def projections(A, count):
    """A^-1 diag(0 (count), I) A, as in (10) and (19), and A^T diag(I (count), 0) A^-T, as in (13) and (21)."""
    chosen = np.arange(len(A)) < count
    inverse = np.linalg.inv(A)
    return inverse @ (~chosen[:, None] * A), (A.T * chosen) @ inverse.T


def contact_force(force_operator, weights, forces):
    """Force on the instrument, N: the sum of the node forces P~ f (14) or Q~ f (22) over the sum of the weights.

    The division gives the multiplier of the constraint; it changes nothing when no node of the support is fixed.
    """
    return (force_operator @ forces.ravel()).reshape(-1, 3).sum(axis=0) / np.sum(weights)
