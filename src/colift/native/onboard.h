#include <math.h>
#include <stdint.h>
#include <string.h>

#ifndef __GNUC__
#define __attribute__(x)
#define __builtin_expect(x, y) (x)
#define __builtin_sqrt sqrt
#define __builtin_fabs fabs
#define __builtin_floor floor
#define __builtin_ceil ceil
#define __builtin_rint rint
#define __builtin_trunc trunc
#endif

#define IN(piece) 1
#define OWN static

/* whether an integer left what a number carries exactly, since the tick began */
static int outside;
