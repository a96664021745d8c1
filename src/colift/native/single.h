/* As lanes.h, for one number of single precision: the same names, every function that of the math library. */
typedef float V_1;
typedef int32_t M_1;

static inline V_1 splat_1(float c) { return c; }

static inline M_1 bits_1(V_1 x) {
  M_1 r;
  memcpy(&r, &x, sizeof r);
  return r;
}

static inline V_1 real_1(M_1 x) {
  V_1 r;
  memcpy(&r, &x, sizeof r);
  return r;
}

static inline M_1 lt_1(V_1 a, V_1 b) { return -(M_1)(a < b); }
static inline M_1 le_1(V_1 a, V_1 b) { return -(M_1)(a <= b); }
static inline M_1 eq_1(V_1 a, V_1 b) { return -(M_1)(a == b); }
static inline M_1 ne_1(V_1 a, V_1 b) { return -(M_1)(a != b); }
static inline V_1 sel_1(M_1 m, V_1 a, V_1 b) { return m ? a : b; }
static inline int any_1(M_1 m) { return m != 0; }
static inline V_1 max_1(V_1 a, V_1 b) { return sel_1(lt_1(b, a) | ne_1(a, a), a, b); }
static inline V_1 min_1(V_1 a, V_1 b) { return sel_1(lt_1(a, b) | ne_1(a, a), a, b); }

#define SINGLE(name, f) \
  static inline V_1 name##_1(V_1 a) { return f(a); }
#define SINGLE2(name, f) \
  static inline V_1 name##_1(V_1 a, V_1 b) { return f(a, b); }
SINGLE(sqrt, sqrtf)
SINGLE(abs, fabsf)
SINGLE(floor, floorf)
SINGLE(ceil, ceilf)
SINGLE(rint, rintf)
SINGLE(trunc, truncf)
SINGLE(tan, tanf)
SINGLE(asin, asinf)
SINGLE(acos, acosf)
SINGLE(atan, atanf)
SINGLE(sinh, sinhf)
SINGLE(cosh, coshf)
SINGLE(tanh, tanhf)
SINGLE(asinh, asinhf)
SINGLE(acosh, acoshf)
SINGLE(atanh, atanhf)
SINGLE(exp, expf)
SINGLE(exp2, exp2f)
SINGLE(expm1, expm1f)
SINGLE(log, logf)
SINGLE(log1p, log1pf)
SINGLE(cbrt, cbrtf)
SINGLE(erf, erff)
SINGLE2(atan2, atan2f)
SINGLE2(pow, powf)
SINGLE2(fmod, fmodf)

/* integers, in single precision: exact below 2^24 */
#define SINGLE_WHOLE(name, low)                        \
  static inline V_1 name##_1(V_1 a) {                  \
    outside |= !(a >= (low) && a <= 16777216.0f);      \
    return a;                                          \
  }
SINGLE_WHOLE(int64, -16777216.0f)
SINGLE_WHOLE(int32, -16777216.0f)
SINGLE_WHOLE(uint32, 0.0f)

static inline void sincos_1(V_1 x, V_1 *sine, V_1 *cosine) {
  *sine = sinf(x);
  *cosine = cosf(x);
}

#undef SINGLE
#undef SINGLE2
#undef SINGLE_WHOLE
