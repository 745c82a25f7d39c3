// The measurement update of visenvs.estimation.stationary in C++: the yardstick of `filter`.
// The records are those of filter.py, field by field; all numbers are SI.

#include <algorithm>
#include <cstddef>

namespace {

struct Problem {
    double rhat[3], P[3][3], C[3][3], pixel[2];
};

struct Solution {
    double rhat[3], P[3][3], innovation[2], nis;
};

struct Settings {
    double sigma_range, sigma_angle, min_range, gate;
};

// Update the prior in `s` with the image point of `p`, in place.
inline void update(Solution& s, const Problem& p, const Settings& cfg) {
    const auto& C = p.C;
    double c[3];  // the estimate in the camera's frame
    for (int i = 0; i < 3; ++i)
        c[i] = C[i][0] * s.rhat[0] + C[i][1] * s.rhat[1] + C[i][2] * s.rhat[2];
    const double per_depth = 1.0 / std::max(c[0], cfg.min_range);
    const double y = c[1] * per_depth, z = c[2] * per_depth;
    const double e0 = s.innovation[0] = p.pixel[0] - y;
    const double e1 = s.innovation[1] = p.pixel[1] - z;

    double H[2][3], PHt[3][2];
    for (int j = 0; j < 3; ++j) {
        H[0][j] = (C[1][j] - y * C[0][j]) * per_depth;
        H[1][j] = (C[2][j] - z * C[0][j]) * per_depth;
    }
    for (int i = 0; i < 3; ++i)
        for (int k = 0; k < 2; ++k)
            PHt[i][k] = s.P[i][0] * H[k][0] + s.P[i][1] * H[k][1] + s.P[i][2] * H[k][2];

    const double sigma = cfg.sigma_range * per_depth;
    const double R = sigma * sigma + cfg.sigma_angle * cfg.sigma_angle;
    double S00 = R, S01 = 0.0, S11 = R;
    for (int j = 0; j < 3; ++j) {
        S00 += H[0][j] * PHt[j][0];
        S01 += H[0][j] * PHt[j][1];
        S11 += H[1][j] * PHt[j][1];
    }
    const double per_det = 1.0 / (S00 * S11 - S01 * S01);
    const double w0 = (S11 * e0 - S01 * e1) * per_det, w1 = (S00 * e1 - S01 * e0) * per_det;
    s.nis = e0 * w0 + e1 * w1;
    if (cfg.gate > 0.0 && s.nis > cfg.gate * cfg.gate) return;

    for (int i = 0; i < 3; ++i) {
        s.rhat[i] += PHt[i][0] * w0 + PHt[i][1] * w1;
        const double k0 = (PHt[i][0] * S11 - PHt[i][1] * S01) * per_det;  // gain
        const double k1 = (PHt[i][1] * S00 - PHt[i][0] * S01) * per_det;
        for (int j = 0; j <= i; ++j)
            s.P[i][j] = s.P[j][i] = s.P[i][j] - k0 * PHt[j][0] - k1 * PHt[j][1];
    }
}

}  // namespace

extern "C" void update_all(const Problem* problems, std::size_t count, const Settings* cfg,
                           Solution* solutions) {
    for (std::size_t k = 0; k < count; ++k) {
        Solution& s = solutions[k];
        std::copy_n(problems[k].rhat, 3, s.rhat);
        std::copy_n(&problems[k].P[0][0], 9, &s.P[0][0]);
        update(s, problems[k], *cfg);
    }
}
