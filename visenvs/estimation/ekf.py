"""The extended Kalman filter, written out for small states (thesis (2.7)-(2.19)).

The covariance stays symmetric: only one triangle is computed, and the other mirrors it.
`work` arrays belong to the caller, so that nothing is allocated in a loop over lanes.
"""

from __future__ import annotations

import math

from visenvs.core.compile import kernel


@kernel
def predict_covariance(P, Phi, Q, work):
    """P <- Phi P Phi' + Q, in place (2.16). Shapes (n, n); `work` is (n, n)."""
    n = P.shape[0]
    for i in range(n):
        for j in range(n):
            total = 0.0
            for m in range(n):
                total += Phi[i, m] * P[m, j]
            work[i, j] = total
    for i in range(n):
        for j in range(i + 1):
            total = 0.5 * (Q[i, j] + Q[j, i])
            for m in range(n):
                total += work[i, m] * Phi[j, m]
            P[i, j] = total
            P[j, i] = total


@kernel
def white_acceleration(q, dt):
    """What white acceleration of a spectral density q (m^2/s^3) adds in dt s along one axis.

    Returns:
        The variance of the position, m^2, its covariance with the velocity, and the latter's.
    """
    speed = q * dt
    return speed * dt * dt / 3.0, 0.5 * speed * dt, speed


@kernel
def update_scalar(x, P, H, i, residual, variance, work):
    """Update with measurement i of a linearised set, in place; returns its innovation variance S.

    Args:
        x, P: state (n,) and covariance (n, n).
        H: Jacobian (m, n); row i is used.
        residual: measured minus predicted.
        variance: of this measurement's noise, > 0 and independent of the others.
        work: scratch, (n,); holds P h on return.
    """
    n = x.shape[0]
    S = variance
    for a in range(n):
        total = 0.0
        for b in range(n):
            total += P[a, b] * H[i, b]
        work[a] = total
    for a in range(n):
        S += H[i, a] * work[a]
    for a in range(n):
        gain = work[a] / S
        x[a] += gain * residual
        for b in range(a + 1):
            P[a, b] -= gain * work[b]
            P[b, a] = P[a, b]
    return S


@kernel
def update_sequential(x, P, H, residual, variance, gate, B, S):
    """Update with m measurements of independent noise, one by one, in place; returns the NIS.

    Each is freed of what the earlier ones told: b_i = P h_i - sum_k<i b_k (b_k' h_i) / S_k, with
    S_i = variance_i + h_i' b_i. Then x += b_i e_i / S_i and P -= b_i b_i' / S_i are the vector
    update (2.17)-(2.19), without a root or an inverse. All rows are linearised at the prediction.

    Args:
        residual, variance: shape (m,); residual is replaced by the independent innovations e.
        gate: the update is left out where the NIS exceeds gate^2; 0 for no gate.
        B: scratch, (m, n); row i is b_i on return.
        S: scratch, (m,); holds 1 / S_i on return.
    """
    n, nis = x.shape[0], 0.0
    for i in range(residual.shape[0]):
        for a in range(n):
            total = 0.0
            for b in range(n):
                total += P[a, b] * H[i, b]
            B[i, a] = total
        for k in range(i):
            shared = 0.0
            for a in range(n):
                shared += B[k, a] * H[i, a]
            shared *= S[k]
            residual[i] -= shared * residual[k]
            for a in range(n):
                B[i, a] -= shared * B[k, a]
        total = variance[i]
        for a in range(n):
            total += H[i, a] * B[i, a]
        S[i] = 1.0 / total if total > 0.0 else 0.0
        nis += residual[i] * residual[i] * S[i]
    if gate > 0.0 and nis > gate * gate:
        return nis
    for i in range(residual.shape[0]):
        for a in range(n):
            gain = B[i, a] * S[i]
            x[a] += gain * residual[i]
            for b in range(a + 1):
                P[a, b] -= gain * B[i, b]
                P[b, a] = P[a, b]
    return nis


@kernel
def update_vector(x, P, H, residual, R, gate, B, factor):
    """Update with m measurements of correlated noise R (m, m), in place; returns the NIS.

    This is (2.17)-(2.19) with the Cholesky factor L of S = H P H' + R and B = P H' L'^-1:
    x += B L^-1 residual, P -= B B'.

    Args:
        residual: shape (m,); replaced by the whitened innovation L^-1 residual.
        gate: the update is left out where the NIS exceeds gate^2; 0 for no gate.
        B: scratch, (n, m).
        factor: scratch, (m (m + 1) / 2,); holds the packed L on return.
    """
    n, m = B.shape
    for a in range(n):
        for i in range(m):
            total = 0.0
            for b in range(n):
                total += P[a, b] * H[i, b]
            B[a, i] = total
    k = 0
    for i in range(m):
        for j in range(i + 1):
            total = 0.5 * (R[i, j] + R[j, i])
            for a in range(n):
                total += H[i, a] * B[a, j]
            factor[k] = total
            k += 1
    factorise(factor, m)
    nis = whiten(factor, residual, residual)
    if gate > 0.0 and nis > gate * gate:
        return nis
    for a in range(n):
        whiten(factor, B[a], B[a])
        for i in range(m):
            x[a] += B[a, i] * residual[i]
        for b in range(a + 1):
            for i in range(m):
                P[a, b] -= B[a, i] * B[b, i]
            P[b, a] = P[a, b]
    return nis


@kernel
def pack_lower(A, packed):
    """Write the lower triangle of a matrix (n, n), row by row, into (n (n + 1) / 2,)."""
    k = 0
    for i in range(A.shape[0]):
        for j in range(i + 1):
            packed[k] = A[i, j]
            k += 1


@kernel
def factorise(packed, n):
    """Replace a packed symmetric matrix by its packed lower Cholesky factor.

    Pivots that rounding made negative count as zero, and so do their columns: a singular covariance
    (perfect information has all zeros) has a factor too.
    """
    row = 0
    for i in range(n):
        column = 0
        for j in range(i + 1):
            total = packed[row + j]
            for k in range(j):
                total -= packed[row + k] * packed[column + k]
            if i == j:
                packed[row + j] = math.sqrt(total) if total > 0.0 else 0.0
            else:
                pivot = packed[column + j]
                packed[row + j] = total / pivot if pivot > 0.0 else 0.0
            column += j + 1
        row += i + 1


@kernel
def whiten(factor, error, out):
    """Solve L out = error for a packed L; returns |out|^2, that is NEES or NIS.

    Directions of a zero pivot carry no information and count as zero. `out` may be `error` itself.
    """
    square = 0.0
    row = 0
    for i in range(error.shape[0]):
        total = error[i]
        for k in range(i):
            total -= factor[row + k] * out[k]
        pivot = factor[row + i]
        out[i] = total / pivot if pivot > 0.0 else 0.0
        square += out[i] * out[i]
        row += i + 1
    return square
