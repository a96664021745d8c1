/* Vector types of the compiler, and elementwise functions for them.
 *
 * Included once for each number of lanes, LANES. AT_LANES(x, l) is lane l of a vector; WIDTH_LANES is the number of
 * lanes, one if the compiler has no vector types. V is the vector type, M its mask (all ones or all zeros per lane),
 * N(name) the name of a function for this width. A vector of one lane is a number. `real` and `integer` are float and
 * int32_t if SINGLE is defined, else double and int64_t.
 */
#define JOIN_(a, b) a##_##b
#define JOIN(a, b) JOIN_(a, b)
#define N(name) JOIN(name, LANES)
#define V N(V)
#define M N(M)
#define AT N(AT)
#define WIDTH N(WIDTH)

#if LANES == 1 || defined ONE_LANE
typedef real V;
typedef integer M;
#else
typedef real V __attribute__((vector_size(sizeof(real) * LANES)));
typedef integer M __attribute__((vector_size(sizeof(real) * LANES)));
#endif

#ifdef SINGLE
#define F(name) name##f
#else
#define F(name) name
#endif

static inline V N(splat)(real c) {
  V r;
  for (int i = 0; i < WIDTH; i++) AT(r, i) = c;
  return r;
}

static inline M N(bits)(V x) {
  M r;
  memcpy(&r, &x, sizeof r);
  return r;
}

static inline V N(real)(M x) {
  V r;
  memcpy(&r, &x, sizeof r);
  return r;
}

#if LANES == 1 || defined ONE_LANE
static inline M N(lt)(V a, V b) { return -(M)(a < b); }
static inline M N(le)(V a, V b) { return -(M)(a <= b); }
static inline M N(eq)(V a, V b) { return -(M)(a == b); }
static inline M N(ne)(V a, V b) { return -(M)(a != b); }
static inline V N(sel)(M m, V a, V b) { return m ? a : b; }
static inline int N(any)(M m) { return m != 0; }
#else
static inline M N(lt)(V a, V b) { return (M)(a < b); }
static inline M N(le)(V a, V b) { return (M)(a <= b); }
static inline M N(eq)(V a, V b) { return (M)(a == b); }
static inline M N(ne)(V a, V b) { return (M)(a != b); }
static inline V N(sel)(M m, V a, V b) { return (V)(((M)a & m) | ((M)b & ~m)); }
static inline int N(any)(M m) {
  integer r = 0;
  for (int i = 0; i < WIDTH; i++) r |= AT(m, i);
  return r != 0;
}
#endif

/* maximum and minimum of IEEE 754-2019: the result is NaN if an argument is NaN */
static inline V N(max)(V a, V b) { return N(sel)(N(lt)(b, a) | N(ne)(a, a), a, b); }
static inline V N(min)(V a, V b) { return N(sel)(N(lt)(a, b) | N(ne)(a, a), a, b); }

#define LANEWISE(name, f)                                     \
  static inline V N(name)(V a) {                              \
    V r;                                                      \
    for (int i = 0; i < WIDTH; i++) AT(r, i) = f(AT(a, i));   \
    return r;                                                 \
  }
#define LANEWISE2(name, f)                                              \
  static inline V N(name)(V a, V b) {                                   \
    V r;                                                                \
    for (int i = 0; i < WIDTH; i++) AT(r, i) = f(AT(a, i), AT(b, i));   \
    return r;                                                           \
  }
LANEWISE(sqrt, F(__builtin_sqrt))
LANEWISE(abs, F(__builtin_fabs))
LANEWISE(floor, F(__builtin_floor))
LANEWISE(ceil, F(__builtin_ceil))
LANEWISE(rint, F(__builtin_rint))
LANEWISE(trunc, F(__builtin_trunc))
LANEWISE(tan, F(tan))
LANEWISE(asin, F(asin))
LANEWISE(acos, F(acos))
LANEWISE(atan, F(atan))
LANEWISE(sinh, F(sinh))
LANEWISE(cosh, F(cosh))
LANEWISE(tanh, F(tanh))
LANEWISE(asinh, F(asinh))
LANEWISE(acosh, F(acosh))
LANEWISE(atanh, F(atanh))
LANEWISE(exp2, F(exp2))
LANEWISE(expm1, F(expm1))
LANEWISE(log, F(log))
LANEWISE(log1p, F(log1p))
LANEWISE(cbrt, F(cbrt))
LANEWISE(erf, F(erf))
LANEWISE2(atan2, F(atan2))
LANEWISE2(pow, F(pow))
LANEWISE2(fmod, F(fmod))

/* range check of integers that are carried as floating-point numbers: the value is returned unchanged; a flag is set if
 * it is outside the range of its type or not exact (2^53 or more, in single precision 2^24 or more) */
#ifdef SINGLE
#define EXACT(bound) 16777216.0f
#else
#define EXACT(bound) bound
#endif
#define WHOLE(name, low, high)                                                                   \
  static inline V N(name)(V a) {                                                                 \
    integer_overflow |= N(any)(~(N(le)(N(splat)(low), a) & N(le)(a, N(splat)(high))));           \
    return a;                                                                                    \
  }
WHOLE(int64, -EXACT(9007199254740991.0), EXACT(9007199254740991.0))
WHOLE(int32, -EXACT(2147483648.0), EXACT(2147483647.0))
WHOLE(uint32, 0.0, EXACT(4294967295.0))

#ifdef SINGLE
LANEWISE(exp, expf)
static inline void N(sincos)(V x, V *sine, V *cosine) {
  for (int i = 0; i < WIDTH; i++) AT(*sine, i) = sinf(AT(x, i));
  for (int i = 0; i < WIDTH; i++) AT(*cosine, i) = cosf(AT(x, i));
}
#else

/* Sine and cosine: range reduction by pi/2 in two parts, then the polynomials of fdlibm (k_sin.c, k_cos.c); error below
 * 1 ulp. Arguments that are too large for the two-part reduction use the C library.
 *
 * Notice of fdlibm: Copyright (C) 1993 by Sun Microsystems, Inc. All rights reserved. Developed at SunSoft, a Sun
 * Microsystems, Inc. business. Permission to use, copy, modify, and distribute this software is freely granted,
 * provided that this notice is preserved. */
static inline void N(sincos)(V x, V *sine, V *cosine) {
  if (__builtin_expect(N(any)(~N(lt)(N(abs)(x), N(splat)(1e5))), 0)) {
    for (int i = 0; i < WIDTH; i++) AT(*sine, i) = sin(AT(x, i));
    for (int i = 0; i < WIDTH; i++) AT(*cosine, i) = cos(AT(x, i));
    return;
  }
  const double round = 6755399441055744.0; /* 1.5 * 2^52; adding it puts the nearest integer into the low bits */
  V shifted = x * 0.63661977236758134308 + round;
  M quadrant = N(bits)(shifted);
  V k = shifted - round;
  V t = x - k * 1.57079632673412561417;
  V low = k * 6.07710050650619224932e-11;
  V y = t - low;
  V tail = (t - y) - low;
  V z = y * y;
  V p = 8.33333333332248946124e-03 +
        z * (-1.98412698298579493134e-04 +
             z * (2.75573137070700676789e-06 + z * (-2.50507602534068634195e-08 + z * 1.58969099521155010221e-10)));
  V v = z * y;
  V s = y - ((z * (0.5 * tail - v * p) - tail) - v * -1.66666666666666324348e-01);
  V q = z * (4.16666666666666019037e-02 +
             z * (-1.38888888888741095749e-03 +
                  z * (2.48015872894767294178e-05 +
                       z * (-2.75573143513906633035e-07 + z * (2.08757232129817482790e-09 + z * -1.13596475577881948265e-11)))));
  V half = 0.5 * z;
  V w = 1.0 - half;
  V c = w + (((1.0 - w) - half) + (z * q - y * tail));
  const integer sign = INT64_MIN; /* the sign bit of a double */
  M odd = -(quadrant & 1);
  *sine = N(real)(N(bits)(N(sel)(odd, c, s)) ^ (-((quadrant >> 1) & 1) & sign));
  *cosine = N(real)(N(bits)(N(sel)(odd, s, c)) ^ (-(((quadrant + 1) >> 1) & 1) & sign));
}

/* e^x = 2^k e^r with |r| at most ln 2 / 2, e^r by a Taylor polynomial of order 13; error below 1 ulp */
static inline V N(exp)(V x) {
  const double round = 6755399441055744.0; /* as in sincos */
  x = N(min)(N(max)(x, N(splat)(-750.0)), N(splat)(710.0)); /* the result is zero or infinity beyond; a NaN is kept */
  V shifted = x * 1.44269504088896338700 + round;
  V k = shifted - round;
  V r = (x - k * 6.93147180369123816490e-01) - k * 1.90821492927058770002e-10;
  V r2 = r * r, r4 = r2 * r2;
  V a = (0.5 + r * 0.16666666666666666) + r2 * (0.041666666666666664 + r * 0.008333333333333333);
  V b = (0.001388888888888889 + r * 0.0001984126984126984) + r2 * (2.48015873015873e-05 + r * 2.7557319223985893e-06);
  V c = (2.755731922398589e-07 + r * 2.505210838544172e-08) + r2 * (2.08767569878681e-09 + r * 1.6059043836821613e-10);
  V q = a + r4 * (b + r4 * c);
  M n = N(bits)(shifted) - N(bits)(N(splat)(round));
  M half = n >> 1; /* in two factors, because 2^k may overflow although the product does not */
  return (1.0 + (r + r2 * q)) * N(real)((half + 1023) << 52) * N(real)((n - half + 1023) << 52);
}

#endif

#undef LANEWISE
#undef LANEWISE2
#undef WHOLE
#undef EXACT
#undef F
#undef WIDTH
#undef AT
#undef V
#undef M
#undef LANES
