"""The Kalman filter on factors P = U D U', U unit upper triangular (n, n), D diagonal, as (n,).

A covariance in this form cannot lose symmetry, and loses its sign only where D does, which no step
here lets happen: every D is a sum or a quotient of positive numbers. It therefore works in single
precision where the conventional filter and Joseph's form do not (`eval.reproduce ud`).

States that move come first and those that stand still last: then a prediction leaves the factors of
the latter alone (`predict_leading`), and one of them can be replaced by something new (`replace`).

Bierman (1977), "Factorization methods for discrete sequential estimation"; Thornton (1976).
Sums are kept in arrays, so that the kernels work in the precision of what they are given.
"""

from __future__ import annotations

from visenvs.core.compile import kernel


@kernel
def factorise(P, U, D):
    """Write the factors of a covariance (n, n); pivots that are not positive count as zero."""
    n = P.shape[0]
    for j in range(n):
        for i in range(n):
            U[i, j] = P[i, j] if i <= j else 0
    for j in range(n - 1, -1, -1):
        D[j] = max(U[j, j], 0)
        for i in range(j):
            U[i, j] = U[i, j] / D[j] if D[j] > 0 else 0
        U[j, j] = 1
        for i in range(j):
            for k in range(i + 1):
                U[k, i] -= U[k, j] * D[j] * U[i, j]


@kernel
def covariance(U, D, P):
    """Write P = U D U', (n, n)."""
    n = D.shape[0]
    for i in range(n):
        for j in range(i + 1):
            P[i, j] = 0
            for k in range(i, n):
                P[i, j] += U[i, k] * D[k] * U[j, k]
            P[j, i] = P[i, j]


@kernel
def innovation_variance(U, D, h, variance, f, v):
    """Variance of a scalar measurement h x + noise; f receives U'h and v D U'h, each (n,)."""
    total = variance
    for j in range(D.shape[0]):
        f[j] = h[j]
        for i in range(j):
            f[j] += U[i, j] * h[i]
        v[j] = D[j] * f[j]
        total += f[j] * v[j]
    return total


@kernel
def update(x, U, D, h, residual, variance, f, v, b):
    """Use one scalar measurement, in place; returns its innovation variance (Bierman).

    Args:
        x, U, D: state (n,) and factors.
        h: the measurement's derivative by the state, (n,).
        residual: measured minus predicted.
        variance: of its noise, > 0 and independent of the other measurements.
        f, v, b: scratch, (n,) each; b holds P h on return.
    """
    innovation_variance(U, D, h, variance, f, v)
    alpha = variance
    for j in range(D.shape[0]):
        before = alpha
        alpha = before + f[j] * v[j]
        D[j] *= before / alpha
        gain = -f[j] / before
        b[j] = v[j]
        for i in range(j):
            u = U[i, j]
            U[i, j] = u + b[i] * gain
            b[i] += u * v[j]
    for i in range(D.shape[0]):
        x[i] += b[i] / alpha * residual
    return alpha


@kernel
def orthogonalise(W, weight, U, D):
    """Write the factors of W diag(weight) W' by weighted modified Gram-Schmidt (Thornton).

    Args:
        W: rows (m, k), k >= m; overwritten.
        weight: not negative, (k,).
        U, D: only the leading m by m block and the leading m are written.
    """
    m, k = W.shape
    for j in range(m - 1, -1, -1):
        D[j] = 0
        for c in range(k):
            D[j] += weight[c] * W[j, c] * W[j, c]
        U[j, j] = 1
        for i in range(j):
            U[i, j] = U[j, i] = 0
            for c in range(k):
                U[i, j] += weight[c] * W[i, c] * W[j, c]
            U[i, j] = U[i, j] / D[j] if D[j] > 0 else 0
            for c in range(k):
                W[i, c] -= U[i, j] * W[j, c]


@kernel
def predict_leading(U, D, F, G, q, W, weight, column):
    """P <- F P F' + G diag(q) G' of the first m states, in place; the others stand still.

    Their factors stay, U between the two is multiplied by F, and only a block of m by m + s is
    orthogonalised. m = n predicts the whole state.

    Args:
        F: transition of the first m states, (m, m).
        G: what the noise does to them, (m, s).
        q: variances of the independent noises, (s,).
        W, weight, column: scratch, (m, m + s), (m + s,), (m,).
    """
    m, s = G.shape
    for j in range(m, D.shape[0]):
        for i in range(m):
            column[i] = 0
            for k in range(m):
                column[i] += F[i, k] * U[k, j]
        for i in range(m):
            U[i, j] = column[i]
    for i in range(m):
        for j in range(m):
            W[i, j] = F[i, j]
            for k in range(j):
                W[i, j] += F[i, k] * U[k, j]
        for j in range(s):
            W[i, m + j] = G[i, j]
    for j in range(m):
        weight[j] = D[j]
    for j in range(s):
        weight[m + j] = q[j]
    orthogonalise(W, weight, U, D)


@kernel
def add_rank_one(U, D, n, a, weight):
    """U D U' + weight a a' of the leading n states, in place (Agee and Turner); a is overwritten.

    The weight must not be negative.
    """
    c = weight
    for j in range(n - 1, -1, -1):
        before = D[j]
        D[j] = before + c * a[j] * a[j]
        if D[j] > 0:
            gain = c * a[j] / D[j]
            for i in range(j):
                a[i] -= a[j] * U[i, j]
                U[i, j] += gain * a[i]
            c *= before / D[j]


@kernel
def replace(U, D, j, variance, a):
    """Forget state j and put a new one in its place that nothing is correlated with, in place.

    What the others know of one another is kept. `a` is scratch, (n,).
    """
    for k in range(j + 1, D.shape[0]):
        U[j, k] = 0
    for i in range(j):
        a[i] = U[i, j]
        U[i, j] = 0
    add_rank_one(U, D, j, a, D[j])
    D[j] = variance
