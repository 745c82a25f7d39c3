// One period of visenvs.estimation.polar in C++, errors in logarithms: the yardstick of `formation`.
// The records are those of formation.py, field by field; all numbers are SI.

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace {

constexpr int N = 10, STEPS = 5;
constexpr int U = 0, DU = 3, RHO = 6, S = 7, B = 8, LAT = 9;

struct Problem {
    double x[N], P[N][N], v[3], push[STEPS][3], u[3], alpha;
};

struct Solution {
    double x[N], P[N][N];
};

struct Settings {
    double dt, sigma_image, q_a, q_lat;
};

struct Motion {  // course and speed of the leader, relative acceleration
    double n, e, speed, a[3];
};

inline Motion motion(const double* x, const double* a, const double* v) {
    const double north = (x[DU] + x[U] * x[S]) / x[RHO] + v[0];
    const double east = (x[DU + 1] + x[U + 1] * x[S]) / x[RHO] + v[1];
    const double speed = std::max(std::hypot(north, east), 0.1);
    const double n = north / speed, e = east / speed;
    return {n, e, speed, {a[0] + x[LAT] * e, a[1] - x[LAT] * n, a[2]}};
}

inline double dot(const double* a, const double* b) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

inline void flow(const double* x, const Motion& m, double* f) {
    const double rho = x[RHO], s = x[S];
    const double turn = dot(x + DU, x + DU) - rho * dot(x + U, m.a);
    for (int i = 0; i < 3; ++i) {
        f[U + i] = x[DU + i];
        f[DU + i] = -turn * x[U + i] - 2.0 * s * x[DU + i] - rho * m.a[i];
    }
    f[RHO] = -rho * s;
    f[S] = turn - s * s;
    f[B] = f[LAT] = 0.0;
}

inline void slope(const double* x, const Motion& m, double F[N][N]) {
    const double rho = x[RHO], s = x[S], rate = x[LAT] / m.speed;
    const double inward = dot(x + U, m.a), turn = dot(x + DU, x + DU) - rho * inward;
    for (int i = 0; i < N; ++i)
        for (int j = 0; j < N; ++j) F[i][j] = 0.0;
    const double right[2] = {-m.e, m.n}, ahead[3] = {m.n, m.e, 0.0};
    double g[N] = {};
    for (int k = 0; k < 2; ++k) {
        g[U + k] = right[k] * s / rho;
        g[DU + k] = right[k] / rho;
        g[S] += right[k] * x[U + k] / rho;
        g[RHO] -= right[k] * (x[DU + k] + x[U + k] * s) / rho;
    }
    const double along = x[U] * m.n + x[U + 1] * m.e;
    const double lateral = x[U] * m.e - x[U + 1] * m.n;
    for (int i = 0; i < 3; ++i) {
        const double across = i < 2 ? -right[i] : 0.0;
        F[U + i][DU + i] = 1.0;
        for (int k = 0; k < 8; ++k) F[DU + i][k] = rho * rate * (x[U + i] * along - ahead[i]) * g[k];
        F[DU + i][LAT] = rho * (x[U + i] * lateral - across);
        F[DU + i][U + i] -= turn;
        F[DU + i][DU + i] -= 2.0 * s;
        for (int k = 0; k < 3; ++k) {
            F[DU + i][U + k] += rho * x[U + i] * m.a[k];
            F[DU + i][DU + k] -= 2.0 * x[U + i] * x[DU + k];
        }
        F[DU + i][RHO] += (inward * x[U + i] - m.a[i]) * rho;
        F[DU + i][S] -= 2.0 * x[DU + i];
    }
    for (int k = 0; k < 8; ++k) F[S][k] = -rho * rate * along * g[k];
    F[S][LAT] = -rho * lateral;
    for (int k = 0; k < 3; ++k) {
        F[S][U + k] -= rho * m.a[k];
        F[S][DU + k] += 2.0 * x[DU + k];
    }
    F[S][RHO] -= inward * rho;
    F[S][S] -= 2.0 * s;
    F[RHO][S] = -1.0;
}

inline void constrain(double* x) {
    const double length = std::sqrt(dot(x + U, x + U));
    for (int i = 0; i < 3; ++i) x[U + i] /= length;
    const double along = dot(x + U, x + DU);
    for (int i = 0; i < 3; ++i) x[DU + i] -= along * x[U + i];
}

inline void predict(Solution& s, const double* a, double* v, double dt, const Settings& cfg) {
    double middle[N], f[N], F[N][N], Phi[N][N], M[N][N], Q[N][N] = {};
    flow(s.x, motion(s.x, a, v), f);
    for (int i = 0; i < N; ++i) middle[i] = s.x[i] + 0.5 * dt * f[i];
    for (int i = 0; i < 3; ++i) v[i] += 0.5 * dt * a[i];
    const Motion m = motion(middle, a, v);
    flow(middle, m, f);
    slope(middle, m, F);
    for (int i = 0; i < 3; ++i) v[i] += 0.5 * dt * a[i];
    for (int i = 0; i < N; ++i)
        for (int j = 0; j < N; ++j) {
            double total = 0.0;
            for (int k = 0; k < N; ++k) total += F[i][k] * F[k][j];
            Phi[i][j] = (i == j ? 1.0 : 0.0) + F[i][j] * dt + 0.5 * dt * dt * total;
        }
    const double white = cfg.q_a * dt * middle[RHO] * middle[RHO];
    for (int i = 0; i < 3; ++i) {
        for (int j = 0; j < 3; ++j) Q[DU + i][DU + j] = -white * middle[U + i] * middle[U + j];
        Q[DU + i][DU + i] += white;
    }
    Q[S][S] = white;
    Q[LAT][LAT] = cfg.q_lat * dt;
    for (int i = 0; i < N; ++i)
        for (int j = 0; j < N; ++j) {
            double total = 0.0;
            for (int k = 0; k < N; ++k) total += Phi[i][k] * s.P[k][j];
            M[i][j] = total;
        }
    for (int i = 0; i < N; ++i)
        for (int j = 0; j <= i; ++j) {
            double total = Q[i][j];
            for (int k = 0; k < N; ++k) total += M[i][k] * Phi[j][k];
            s.P[i][j] = s.P[j][i] = total;
        }
    for (int i = 0; i < N; ++i) s.x[i] += dt * f[i];
    s.x[RHO] = std::max(s.x[RHO], 1e-4);
    constrain(s.x);
}

inline void update(Solution& s, const Problem& p, const Settings& cfg) {
    double* x = s.x;
    const double flat = std::max(std::hypot(x[0], x[1]), 1e-9);
    const double half = 0.5 * x[B] * x[RHO], share = 2.0 * half / (1.0 + half * half);
    double H[3][N] = {}, xi[N] = {}, w[N];
    H[0][0] = -x[1] / flat, H[0][1] = x[0] / flat;
    H[1][0] = -x[2] * x[0] / flat, H[1][1] = -x[2] * x[1] / flat, H[1][2] = flat;
    H[2][RHO] = H[2][B] = share;
    const double e[3] = {dot(H[0], p.u), dot(H[1], p.u), p.alpha - 2.0 * std::atan(half)};
    const double noise = cfg.sigma_image * cfg.sigma_image;
    for (int i = 0; i < 3; ++i) {
        double left = e[i], total = i == 2 ? 2.0 * noise : noise;
        for (int a = 0; a < N; ++a) {
            w[a] = 0.0;
            for (int b = 0; b < N; ++b) w[a] += s.P[a][b] * H[i][b];
            left -= H[i][a] * xi[a];
        }
        for (int a = 0; a < N; ++a) total += H[i][a] * w[a];
        for (int a = 0; a < N; ++a) {
            xi[a] += w[a] / total * left;
            for (int b = 0; b <= a; ++b) s.P[a][b] = s.P[b][a] = s.P[a][b] - w[a] / total * w[b];
        }
    }
    for (int j = 0; j < N; ++j)
        if (j != RHO && j != B) x[j] += xi[j];
    x[RHO] *= std::exp(xi[RHO]);
    x[B] *= std::exp(xi[B]);
    constrain(x);
}

}  // namespace

extern "C" void run_all(const Problem* problems, std::size_t count, const Settings* cfg,
                        Solution* solutions) {
    const double dt = cfg->dt / STEPS;
    for (std::size_t k = 0; k < count; ++k) {
        const Problem& p = problems[k];
        Solution& s = solutions[k];
        std::copy(p.x, p.x + N, s.x);
        std::copy(&p.P[0][0], &p.P[0][0] + N * N, &s.P[0][0]);
        double v[3];
        for (int i = 0; i < 3; ++i) {
            v[i] = p.v[i];
            for (int j = 0; j < STEPS; ++j) v[i] -= dt * p.push[j][i];
        }
        for (int j = 0; j < STEPS; ++j) predict(s, p.push[j], v, dt, *cfg);
        update(s, p, *cfg);
    }
}
