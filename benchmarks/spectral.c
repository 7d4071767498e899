/* The floor of the spectral likelihood: one row of a band's spectrum after the other, written by hand for M readings and R modes.

   It computes what `windsysid.spectral.modal_bands.model.scores` computes for any: with h the response of each mode,
   D = mean of tilt h hᴴ over the taper's window, S = Φ (D ∘ C Cᴴ) Φᴴ + tilt L Lᴴ = G Gᴴ and P the data,

       J = Σ n (ln det S + tr S⁻¹ P),   g_a = Σ n tr A_a (1 − G⁻¹ P G⁻ᴴ),   F_ab = Σ n tr A_a A_b,   A_a = G⁻¹ dS_a G⁻ᴴ,

   a Hermitian matrix being M² real numbers, so that traces of products are inner products. benchmarks/roofline.py compiles it with
   -DM=… -DR=…. */

#include <complex.h>
#include <math.h>
#include <string.h>

typedef double complex cplx;
#ifdef __AVX512F__
#define REGISTER 8 /* doubles */
#else
#define REGISTER 4
#endif
typedef double Vector __attribute__((vector_size(8 * REGISTER)));

#define M2 (M * M)
#define UNKNOWNS (2 * R + 2 * M * R - R + R * (R - 1) + (R > 0) + M + M * (M - 1) + 1)
#define PADDED ((M2 + 7) / 8 * 8)
#define COLUMNS ((UNKNOWNS + 7) / 8 * 8)
#define ALIGNED __attribute__((aligned(64)))

/* x ← G⁻¹ x */
static inline void solve(cplx G[M][M], const double *inverse, cplx *x)
{
    for (int i = 0; i < M; i++) {
        cplx total = x[i];
        for (int j = 0; j < i; j++) total -= G[i][j] * x[j];
        x[i] = total * inverse[i];
    }
}

/* out += scale (u vᴴ + v uᴴ) */
static inline void add(const cplx *u, const cplx *v, double scale, double *out)
{
    int at = M;
    double root2 = scale * M_SQRT2;
    for (int i = 0; i < M; i++) {
        out[i] += 2.0 * scale * creal(u[i] * conj(v[i]));
        for (int j = 0; j < i; j++, at += 2) {
            cplx z = u[i] * conj(v[j]) + v[i] * conj(u[j]);
            out[at] += root2 * creal(z);
            out[at + 1] += root2 * cimag(z);
        }
    }
}

/* v = G⁻¹ Φ (D ∘ B)ᴴ e_j */
static inline void turned(cplx D[R][R], cplx B[R][R], cplx white[R][M], int j, cplx *v)
{
    for (int i = 0; i < M; i++) v[i] = 0.0;
    for (int o = 0; o < R; o++)
        for (int i = 0; i < M; i++) v[i] += conj(D[j][o] * B[j][o]) * white[o][i];
}

static void product(int columns, const cplx *x, int rows, cplx *out)
{
    for (int i = 0; i < rows; i++)
        for (int j = 0; j < rows; j++) {
            out[i * rows + j] = 0.0;
            for (int o = 0; o < columns; o++) out[i * rows + j] += x[i * columns + o] * conj(x[j * columns + o]);
        }
}

/* Power (K, M, M), counts and frequency (K,), fine (F,), first (K,), window (K, W); the modes; room for h and its derivatives (3, F, R)
   and for tilts (2, F). Returns J; adds to gradient and information, of which the lower half is written. */
double score(long K, long F, long W, const cplx *power, const double *counts, const double *frequency, const double *fine,
             const long *first, const double *window, const double *f, const double *zeta, const cplx *shape, const cplx *load,
             const cplx *rest, const double *numbers, const long *real, cplx *room, double *tilts, double *gradient,
             double *information)
{
    cplx(*h)[R] = (void *)room, (*hf)[R] = (void *)(room + F * R), (*hz)[R] = (void *)(room + 2 * F * R);
    cplx B[R][R], level[M][M];
    double value = 0.0, g[UNKNOWNS] = {0};
    static double found[COLUMNS][COLUMNS] ALIGNED, At[M2][COLUMNS] ALIGNED;
    memset(found, 0, sizeof found);
    product(R, load, R, &B[0][0]);
    product(M, rest, M, &level[0][0]);
    for (long i = 0; i < F; i++) {
        tilts[F + i] = log(fine[i] / numbers[0]);
        tilts[i] = exp(numbers[1] * tilts[F + i]);
        for (int j = 0; j < R; j++) {
            double ratio = fine[i] / f[j], x = ratio * ratio;
            cplx q = 1.0 / (1.0 - x + I * (2.0 * zeta[j] * ratio));
            h[i][j] = -x * q;
            hf[i][j] = 2.0 * x * q - x * ratio * (-2.0 * ratio + I * (2.0 * zeta[j])) * q * q;
            hz[i][j] = zeta[j] * x * (I * (2.0 * ratio)) * q * q;
        }
    }
    for (long k = 0; k < K; k++, power += M2, window += W) {
        double height = log(frequency[k] / numbers[0]), tilt = exp(numbers[2] * height), bend = height * tilt, size = sqrt(counts[k]);
        double A[UNKNOWNS][PADDED] ALIGNED = {{0}}, misfit[PADDED] ALIGNED = {0}, inverse[M], *row = A[0];
        cplx D[R][R] = {{0}}, Df[R][R] = {{0}}, Dz[R][R] = {{0}}, Da[R][R] = {{0}}, ahead[R][M], G[M][M];
        cplx axes[M][M] = {{0}}, z[M][M], white[R][M], inner[R][M], v[M];
        for (long w = 0; w < W; w++) {
            long at = first[k] + w;
            for (int o = 0; o < R; o++) {
                cplx other = window[w] * tilts[at] * conj(h[at][o]);
                for (int j = 0; j < R; j++) {
                    Df[j][o] += hf[at][j] * other;
                    Dz[j][o] += hz[at][j] * other;
                    if (j < o) continue;
                    D[j][o] += h[at][j] * other;
                    Da[j][o] += tilts[F + at] * (h[at][j] * other);
                }
            }
        }
        for (int j = 0; j < R; j++)
            for (int o = 0; o < j; o++) {
                D[o][j] = conj(D[j][o]);
                Da[o][j] = conj(Da[j][o]);
            }
        for (int j = 0; j < R; j++)
            for (int i = 0; i < M; i++) {
                ahead[j][i] = 0.0;
                for (int o = 0; o < R; o++) ahead[j][i] += D[j][o] * B[j][o] * conj(shape[i * R + o]);
            }
        for (int i = 0; i < M; i++)
            for (int j = 0; j <= i; j++) {
                cplx total = tilt * level[i][j];
                for (int o = 0; o < R; o++) total += shape[i * R + o] * ahead[o][j];
                for (int o = 0; o < j; o++) total -= G[i][o] * conj(G[j][o]);
                if (j < i) G[i][j] = total * inverse[j];
                else {
                    double pivot = creal(total);
                    if (!(pivot > 0.0)) return INFINITY;
                    value += counts[k] * log(pivot);
                    G[i][i] = sqrt(pivot);
                    inverse[i] = 1.0 / sqrt(pivot);
                }
            }
        for (int i = 0; i < M; i++) {
            axes[i][i] = 1.0;
            for (int j = 0; j < M; j++) z[i][j] = rest[j * M + i];
            solve(G, inverse, axes[i]);
            solve(G, inverse, z[i]);
        }
        for (int j = 0; j < R; j++) {
            for (int i = 0; i < M; i++) white[j][i] = shape[i * R + j];
            solve(G, inverse, white[j]);
        }
        /* 1 − G⁻¹ P G⁻ᴴ */
        for (int i = 0, at = M; i < M; i++) {
            cplx left[M] = {0};
            for (int p = 0; p <= i; p++)
                for (int q = 0; q < M; q++) left[q] += axes[p][i] * power[p * M + q];
            for (int j = 0; j <= i; j++) {
                cplx total = 0.0;
                for (int q = 0; q <= j; q++) total += left[q] * conj(axes[q][j]);
                if (j == i) {
                    misfit[i] = size * (1.0 - creal(total));
                    value += counts[k] * creal(total);
                } else {
                    misfit[at++] = -size * M_SQRT2 * creal(total);
                    misfit[at++] = -size * M_SQRT2 * cimag(total);
                }
            }
        }
        for (int which = 0; which < 2; which++) /* ln f, ln ζ */
            for (int j = 0; j < R; j++, row += PADDED) {
                turned(which ? Dz : Df, B, white, j, v);
                add(white[j], v, size, row);
            }
        for (int j = 0; j < R; j++) turned(D, B, white, j, inner[j]);
        for (int which = 0; which < 2; which++) /* Φ */
            for (int j = 0; j < R; j++) {
                for (int i = 0; i < M; i++) v[i] = which ? -I * inner[j][i] : inner[j][i];
                for (int i = 0; i < M; i++) {
                    if (which && i == real[j]) continue;
                    add(axes[i], v, size, row);
                    row += PADDED;
                }
            }
        for (int which = 0; which < 2; which++) /* C */
            for (int i = 1; i < R; i++)
                for (int j = 0; j < i; j++, row += PADDED) {
                    for (int q = 0; q < M; q++) v[q] = 0.0;
                    for (int o = j; o < R; o++) {
                        cplx weight = conj(D[i][o] * conj(load[o * R + j]) * (which ? I : 1.0));
                        for (int q = 0; q < M; q++) v[q] += weight * white[o][q];
                    }
                    add(white[i], v, size, row);
                }
        if (R) { /* slope of the loads */
            for (int j = 0; j < R; j++) {
                turned(Da, B, white, j, v);
                add(white[j], v, 0.5 * size, row);
            }
            row += PADDED;
        }
        for (int i = 0; i < M; i++, row += PADDED) add(z[i], z[i], 0.5 * size * tilt, row);
        for (int which = 0; which < 2; which++) /* L */
            for (int i = 1; i < M; i++)
                for (int j = 0; j < i; j++, row += PADDED) {
                    for (int q = 0; q < M; q++) v[q] = which ? -I * z[j][q] : z[j][q];
                    add(z[i], v, size * tilt, row);
                }
        for (int i = 0; i < M; i++) add(z[i], z[i], 0.5 * size * bend, row);
        for (int a = 0; a < UNKNOWNS; a++)
            for (int i = 0; i < M2; i++) {
                g[a] += A[a][i] * misfit[i];
                At[i][a] = A[a][i];
            }
        for (int a = 0; a < UNKNOWNS; a += 4) /* four rows of the lower half, eight columns at a time */
            for (int b = 0; b <= a + 3; b += REGISTER) {
                Vector sum[4];
                for (int j = 0; j < 4; j++) sum[j] = *(Vector *)&found[a + j][b];
                for (int i = 0; i < M2; i++)
                    for (int j = 0; j < 4; j++) sum[j] += At[i][a + j] * *(Vector *)&At[i][b];
                for (int j = 0; j < 4; j++) *(Vector *)&found[a + j][b] = sum[j];
            }
    }
    for (int a = 0; a < UNKNOWNS; a++) {
        gradient[a] = g[a];
        for (int b = 0; b <= a; b++) information[a * UNKNOWNS + b] = information[b * UNKNOWNS + a] = found[a][b];
    }
    return value;
}
