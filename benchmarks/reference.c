/* The floor: the joint extended Kalman filter of one turbine, written by hand for its sizes, computing what windsysid computes for any.

   The state is [x | z | θ]: NX mechanical states (displacements, then velocities), NZ first-order Gauss–Markov loads, one on each degree
   of freedom, and NT parameters in filter coordinates, p = scale · exp(θ) or scale · θ. x goes through RK4 with its sensitivities to
   x₀, w₀, w₁ and p; the load noise reaches it through w₁, inside its own step, and the deviation of each load from a straight line
   within the step through w₀ and w₁. Readings are taken in one at a time, and all of them reach the covariance at once; NaN is a missing reading.

   benchmarks/speed.py writes model.h: the sizes NX, NZ, NT, NU, NP, M, and windsysid's equations of motion and readings in C. It also
   compiles and runs this file. All sizes are known to the compiler; rows are padded to whole registers, so that its loops have no remainder.
   With -DVECTORS the row sums are written in GCC's vector type instead of left to the compiler. With -DLANES=8 (or 4,
   as many as a register has), and no parameters in the state, it is eight filters at once, of models that differ in their numbers: every
   number is a vector with one lane for each filter, and row sums take four columns at a time, so that they stay in registers. It then writes what windsysid's bank does. */

#include <math.h>
#include <string.h>

#ifdef LANES
typedef double real __attribute__((vector_size(8 * LANES)));
#define EACH(name)                                                \
    static inline real lanes_##name(real x)                       \
    {                                                             \
        for (int lane = 0; lane < LANES; lane++) x[lane] = name(x[lane]); \
        return x;                                                 \
    }
EACH(sin) EACH(cos) EACH(exp) EACH(log) EACH(sqrt)
#define sin(x) _Generic((x), real: lanes_sin, default: sin)(x)
#define cos(x) _Generic((x), real: lanes_cos, default: cos)(x)
#define exp(x) _Generic((x), real: lanes_exp, default: exp)(x)
#define log(x) _Generic((x), real: lanes_log, default: log)(x)
#define sqrt(x) _Generic((x), real: lanes_sqrt, default: sqrt)(x)
#else
typedef double real;
#endif
#define ALL(x) ((x) + (real){0}) /* in all lanes */

#include "model.h"

#define N (NX + NZ + NT)
#define NQ (NX / 2)
#define SOME(n) ((n) ? (n) : 1) /* no array of nothing */
#ifdef LANES
#define PADDED(n) (((n) + 3) / 4 * 4)
#else
#define PADDED(n) (((n) + 7) / 8 * 8)
#endif
#define W PADDED(N)
#define WS PADDED(NX + 2 * NZ + NT) /* columns of the sensitivities: x₀, w₀, w₁, p */
#define WX PADDED(NX)
#define ALIGNED __attribute__((aligned(64)))

typedef struct {
    double step;             /* [s] */
    const real *p;           /* NP physical parameters; those identified are replaced from θ */
    const long *chosen;      /* NT: which of them are identified, */
    const double *scale;     /* NT: what they are at θ = 0 or 1, */
    const long *logarithmic; /* NT: and whether p = scale · exp(θ) */
    const real *phi, *q;     /* NZ: transition of each load, and the variance of its noise, */
    const real *within;      /* NZ: and the variance of its deviation from a straight line within a step */
    const real *r;           /* M: variance of each reading's noise */
} Model;

typedef struct {
    real *mean, *std, *innovation, *innovation_std, *whitened, *whitening_std, *log_likelihood;
} Info;

typedef struct {
    real p[NP], slope[SOME(NT)]; /* and ∂p/∂θ */
    real mean[W] ALIGNED, P[N][W] ALIGNED;
} Belief;

/* row[c] = Σ_j weight[j] matrix[j][c] */
#ifdef LANES
#define COMBINE(row, weight, count, matrix, width)                                          \
    do {                                                                                    \
        for (int c_ = 0; c_ < (width); c_ += 4) {                                           \
            real a_ = {0}, b_ = {0}, d_ = {0}, e_ = {0};                                    \
            for (int j_ = 0; j_ < (count); j_++) {                                          \
                real w_ = (weight)[j_];                                                     \
                a_ += w_ * (matrix)[j_][c_], b_ += w_ * (matrix)[j_][c_ + 1];               \
                d_ += w_ * (matrix)[j_][c_ + 2], e_ += w_ * (matrix)[j_][c_ + 3];           \
            }                                                                               \
            (row)[c_] = a_, (row)[c_ + 1] = b_, (row)[c_ + 2] = d_, (row)[c_ + 3] = e_;     \
        }                                                                                   \
    } while (0)
#elif defined(VECTORS)
#ifdef __AVX512F__
#define REGISTER 8
#else
#define REGISTER 4
#endif
typedef double Vector __attribute__((vector_size(8 * REGISTER)));
#define COMBINE(row, weight, count, matrix, width)                                                                                 \
    do {                                                                                                                           \
        Vector sum_[(width) / REGISTER];                                                                                           \
        for (int c_ = 0; c_ < (width) / REGISTER; c_++) sum_[c_] = (Vector){0};                                                    \
        for (int j_ = 0; j_ < (count); j_++)                                                                                       \
            for (int c_ = 0; c_ < (width) / REGISTER; c_++) sum_[c_] += (weight)[j_] * *(Vector *)&(matrix)[j_][REGISTER * c_];    \
        memcpy(row, sum_, sizeof sum_);                                                                                            \
    } while (0)
#else
#define COMBINE(row, weight, count, matrix, width)                                             \
    do {                                                                                       \
        double sum_[width] ALIGNED = {0};                                                      \
        for (int j_ = 0; j_ < (count); j_++)                                                   \
            for (int c_ = 0; c_ < (width); c_++) sum_[c_] += (weight)[j_] * (matrix)[j_][c_]; \
        memcpy(row, sum_, sizeof sum_);                                                        \
    } while (0)
#endif

static void set_parameters(const Model *model, Belief *b)
{
    for (int j = 0; j < NT; j++) {
        real theta = b->mean[NX + NZ + j];
        double scale = model->scale[j];
        real value = model->logarithmic[j] ? scale * exp(theta) : scale * theta;
        b->p[model->chosen[j]] = value;
        b->slope[j] = model->logarithmic[j] ? value : ALL(scale);
    }
}

static void predict(const Model *model, Belief *b, const double *before, const double *after)
{
    static const double at[] = {0.0, 0.5, 0.5, 1.0}, share[] = {1.0 / 6, 1.0 / 3, 1.0 / 3, 1.0 / 6}, reach[] = {0.5, 0.5, 1.0, 0.0};
    double h = model->step, u[NU];
    real x[NX], rate[NX], total[NX] = {}, w0[NZ], w1[NZ], w[NZ];
    real A[NX][NX] = {}, B[NX][SOME(NT)] = {}, G[NX][NZ] = {};
    real S[NX][WS] ALIGNED = {}, slope[NX][WS] ALIGNED, sum[NX][WS] ALIGNED = {};

    set_parameters(model, b);
    for (int i = 0; i < NZ; i++) {
        w0[i] = before[NU + i] + b->mean[NX + i];
        w1[i] = after[NU + i] + model->phi[i] * b->mean[NX + i];
    }
    memcpy(x, b->mean, sizeof x);
    for (int i = 0; i < NX; i++) S[i][i] = ALL(1.0);
    for (int stage = 0; stage < 4; stage++) {
        double t = at[stage];
        for (int i = 0; i < NU; i++) u[i] = before[i] + t * (after[i] - before[i]);
        for (int i = 0; i < NZ; i++) w[i] = w0[i] + t * (w1[i] - w0[i]);
        rates_jacobian(x, u, b->p, w, rate, &A[0][0], &B[0][0], &G[0][0]);
        for (int i = 0; i < NQ; i++) memcpy(slope[i], S[NQ + i], sizeof slope[i]); /* q̇ is a state */
        for (int i = NQ; i < NX; i++) {
            if (stage) COMBINE(slope[i], A[i], NX, S, WS);
            else { /* S is the identity */
                memset(slope[i], 0, sizeof slope[i]);
                memcpy(slope[i], A[i], sizeof A[i]);
            }
            for (int c = 0; c < NZ; c++) {
                slope[i][NX + c] += (1.0 - t) * G[i][c];
                slope[i][NX + NZ + c] += t * G[i][c];
            }
            for (int c = 0; c < NT; c++) slope[i][NX + 2 * NZ + c] += B[i][c];
        }
        for (int i = 0; i < NX; i++) {
            total[i] += share[stage] * h * rate[i];
            x[i] = b->mean[i] + reach[stage] * h * rate[i];
            for (int c = 0; c < WS; c++) {
                sum[i][c] += share[stage] * h * slope[i][c];
                S[i][c] = reach[stage] * h * slope[i][c];
            }
            S[i][i] += 1.0;
        }
    }
    for (int i = 0; i < NX; i++) {
        b->mean[i] += total[i];
        sum[i][i] += 1.0;
    }
    for (int i = 0; i < NZ; i++) b->mean[NX + i] *= model->phi[i];

    /* the mechanical rows of F, and [F | Γ | V]ᵀ */
    real F[NX][N], Ft[N + 2 * NZ][WX] ALIGNED = {}, FP[NX + NZ][W + PADDED(2 * NZ)] ALIGNED;
    for (int i = 0; i < NX; i++) {
        for (int j = 0; j < NX; j++) F[i][j] = sum[i][j];
        for (int j = 0; j < NZ; j++) F[i][NX + j] = sum[i][NX + j] + sum[i][NX + NZ + j] * model->phi[j];
        for (int j = 0; j < NT; j++) F[i][NX + NZ + j] = sum[i][NX + 2 * NZ + j] * b->slope[j];
        for (int j = 0; j < N; j++) Ft[j][i] = F[i][j];
        for (int j = 0; j < NZ; j++) {
            Ft[N + j][i] = sum[i][NX + NZ + j];
            Ft[N + NZ + j][i] = sum[i][NX + j] + sum[i][NX + NZ + j];
        }
    }
    /* F P, with Γ Q and V R next to it */
    for (int i = 0; i < NX; i++) {
        COMBINE(FP[i], F[i], N, b->P, W);
        for (int j = 0; j < NZ; j++) {
            FP[i][N + j] = Ft[N + j][i] * model->q[j];
            FP[i][N + NZ + j] = Ft[N + NZ + j][i] * model->within[j];
        }
    }
    for (int i = 0; i < NZ; i++)
        for (int c = 0; c < W; c++) FP[NX + i][c] = model->phi[i] * b->P[NX + i][c];
    /* P ← F P Fᵀ + Γ Q Γᵀ + V R Vᵀ */
    for (int i = 0; i < NX; i++) {
        real row[WX] ALIGNED;
        COMBINE(row, FP[i], N + 2 * NZ, Ft, WX);
        for (int j = 0; j < NX; j++) b->P[i][j] = row[j];
        for (int j = 0; j < NZ; j++) b->P[i][NX + j] = FP[i][NX + j] * model->phi[j] + FP[i][N + j];
        for (int j = NX + NZ; j < N; j++) b->P[i][j] = FP[i][j];
    }
    for (int i = 0; i < NZ; i++) {
        for (int j = 0; j < NZ; j++) b->P[NX + i][NX + j] = FP[NX + i][NX + j] * model->phi[j];
        b->P[NX + i][NX + i] += model->q[i];
        for (int j = NX + NZ; j < N; j++) b->P[NX + i][j] = FP[NX + i][j];
    }
    for (int i = 0; i < N; i++)
        for (int j = 0; j < i && j < NX + NZ; j++) b->P[i][j] = b->P[j][i];
}

static void update(const Model *model, Belief *b, const double *inputs, const double *readings, const Info *out)
{
    real w[NZ], y[M], C[M][NX] = {}, D[M][SOME(NT)] = {}, E[M][NZ] = {};
    real H[M][W] ALIGNED = {}, v[M][W] ALIGNED, gains[N][M], about[W] ALIGNED;

    set_parameters(model, b);
    for (int i = 0; i < NZ; i++) w[i] = inputs[NU + i] + b->mean[NX + i];
    reading_jacobian(b->mean, inputs, b->p, w, y, &C[0][0], &D[0][0], &E[0][0]);
    for (int c = 0; c < M; c++) {
        for (int i = 0; i < NX; i++) H[c][i] = C[c][i];
        for (int i = 0; i < NZ; i++) H[c][NX + i] = E[c][i];
        for (int i = 0; i < NT; i++) H[c][NX + NZ + i] = D[c][i] * b->slope[i];
        COMBINE(v[c], H[c], N, b->P, W);
#ifndef LANES
        out->innovation[c] = readings[c] - y[c];
        out->innovation_std[c] = NAN;
        if (isnan(readings[c])) continue;
        double s = model->r[c];
        for (int i = 0; i < W; i++) s += H[c][i] * v[c][i];
        out->innovation_std[c] = sqrt(s);
#endif
    }
    memcpy(about, b->mean, sizeof about);
    *out->log_likelihood = ALL(0.0);
    for (int c = 0; c < M; c++) {
        out->whitened[c] = out->whitening_std[c] = ALL(NAN);
        for (int i = 0; i < N; i++) gains[i][c] = ALL(0.0);
        if (isnan(readings[c])) continue;
        real s = model->r[c], residual = readings[c] - y[c];
        for (int i = 0; i < W; i++) {
            s += H[c][i] * v[c][i];
            residual -= H[c][i] * (b->mean[i] - about[i]);
        }
        real scale = 1.0 / s, std = sqrt(s);
        for (int i = 0; i < W; i++) b->mean[i] += scale * residual * v[c][i];
        for (int d = c + 1; d < M; d++) {
            real share = ALL(0.0);
            for (int i = 0; i < W; i++) share += scale * H[d][i] * v[c][i];
            for (int i = 0; i < W; i++) v[d][i] -= share * v[c][i];
        }
        for (int i = 0; i < N; i++) gains[i][c] = -scale * v[c][i];
        out->whitened[c] = residual / std;
        out->whitening_std[c] = std;
        *out->log_likelihood -= 0.5 * (log(2.0 * M_PI) + out->whitened[c] * out->whitened[c]) + log(std);
    }
    for (int i = 0; i < N; i++) {
        real row[W] ALIGNED;
        COMBINE(row, gains[i], M, v, W);
        for (int j = 0; j < W; j++) b->P[i][j] += row[j];
    }
    for (int i = 0; i < N; i++) {
        for (int j = 0; j < i; j++) b->P[i][j] = b->P[j][i];
#ifndef LANES
        out->mean[i] = b->mean[i];
        out->std[i] = sqrt(b->P[i][i]);
#endif
    }
}

/* Filter T samples from the prior mean (N) and cov (N × N); inputs (T × (NU + NZ)), readings (T × M). */
void run(const Model *model, long samples, const real *mean, const real *cov, const double *inputs, const double *readings, Info out)
{
    static Belief b;
    memset(&b, 0, sizeof b);
    memcpy(b.p, model->p, sizeof b.p);
    memcpy(b.mean, mean, N * sizeof *mean);
    for (int i = 0; i < N; i++) memcpy(b.P[i], cov + i * N, N * sizeof *cov);
    for (long k = 0; k < samples; k++, inputs += NU + NZ, readings += M) {
        if (k > 0) predict(model, &b, inputs - (NU + NZ), inputs);
        update(model, &b, inputs, readings, &out);
        out.mean += N, out.std += N, out.innovation += M, out.innovation_std += M;
        out.whitened += M, out.whitening_std += M, out.log_likelihood += 1;
    }
}
