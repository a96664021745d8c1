#include <math.h>
#include <pthread.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "xla/ffi/api/c_api.h"

typedef double real;
typedef int64_t integer;

/* A long source is compiled in pieces, with PIECE defined; IN selects the functions of a piece. */
#ifdef PIECE
#define IN(piece) (PIECE == (piece))
#define OWN __attribute__((visibility("hidden")))
#else
#define IN(piece) 1
#define OWN static
#endif

/* whether an integer exceeded the range that doubles carry exactly, in this thread, since the flag was cleared */
#ifndef PIECE
static _Thread_local int integer_overflow;
#elif PIECE == 0
OWN _Thread_local int integer_overflow;
#else
extern OWN _Thread_local int integer_overflow;
#endif

static void *allocate(size_t bytes) {
  void *memory = aligned_alloc(64, (bytes + 63) / 64 * 64);
  if (!memory) {
    fprintf(stderr, "colift codegen: cannot allocate %zu bytes\n", bytes);
    abort();
  }
  return memory;
}
