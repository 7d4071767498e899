/* What a core can do at most: multiply-adds in registers, and reading memory of any size. */

#ifdef __AVX512F__
#define REGISTER 8 /* doubles */
#define SUMS 16    /* as many as registers hold, with their factors */
#else
#define REGISTER 4
#define SUMS 12
#endif
typedef double Vector __attribute__((vector_size(8 * REGISTER)));

long flops(void) { return 2 * REGISTER * SUMS; } /* of a turn of `multiply_add` */

/* `turns` times some independent multiply-adds of whole registers */
double multiply_add(long turns)
{
    Vector sum[SUMS], x = (Vector){0} + 0.999999, y = (Vector){0} + 1e-6, total = (Vector){0};
    for (int i = 0; i < SUMS; i++) sum[i] = y * i;
    for (long k = 0; k < turns; k++)
#pragma GCC unroll 16
        for (int i = 0; i < SUMS; i++) sum[i] = sum[i] * x + y;
    for (int i = 0; i < SUMS; i++) total += sum[i];
    return total[0] + total[REGISTER - 1];
}

/* `turns` times the sum of `count` doubles, a multiple of 64 */
double read_all(const double *values, long count, long turns)
{
    Vector sum[8], total = (Vector){0};
    for (int i = 0; i < 8; i++) sum[i] = (Vector){0};
    for (long k = 0; k < turns; k++) {
        const Vector *at = (const Vector *)values;
        __asm__ volatile("" : : "r"(values) : "memory");
        for (long i = 0; i < count / REGISTER; i += 8)
#pragma GCC unroll 8
            for (int j = 0; j < 8; j++) sum[j] += at[i + j];
    }
    for (int i = 0; i < 8; i++) total += sum[i];
    return total[0] + total[REGISTER - 1];
}
