#include <math.h>
#include <stdint.h>
#include <string.h>

/* Vectors have one lane if the processor has no vector unit or the compiler has no vector types (GCC, clang). */
#if !defined __GNUC__ || !(defined __SSE2__ || defined __ARM_NEON)
#define ONE_LANE
#else
#pragma GCC diagnostic ignored "-Wpsabi" /* no function with vector parameters is exported */
#endif

#ifndef __GNUC__
#define __attribute__(x)
#define __builtin_expect(x, y) (x)
#define __builtin_sqrt sqrt
#define __builtin_fabs fabs
#define __builtin_floor floor
#define __builtin_ceil ceil
#define __builtin_rint rint
#define __builtin_trunc trunc
#define __builtin_sqrtf sqrtf
#define __builtin_fabsf fabsf
#define __builtin_floorf floorf
#define __builtin_ceilf ceilf
#define __builtin_rintf rintf
#define __builtin_truncf truncf
#endif

typedef colift_real real;
#ifdef COLIFT_FLOAT32
#define SINGLE
typedef int32_t integer;
#else
typedef int64_t integer;
#endif

#define IN(piece) 1
#define OWN static

/* whether an integer exceeded the range that a number carries exactly, since the step began */
static int integer_overflow;
