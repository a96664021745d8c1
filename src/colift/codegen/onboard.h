#include <math.h>
#include <stdint.h>
#include <string.h>

/* Without a processor's vectors, or GCC's and clang's types of them, one number at a time. */
#if !defined __GNUC__ || !(defined __SSE2__ || defined __ARM_NEON)
#define ONE_LANE
#else
#pragma GCC diagnostic ignored "-Wpsabi" /* no vector leaves this file */
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
typedef int32_t whole;
#else
typedef int64_t whole;
#endif

#define IN(piece) 1
#define OWN static

/* whether an integer left what a number carries exactly, since the tick began */
static int outside;
