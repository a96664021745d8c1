#include <math.h>
#include <pthread.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "xla/ffi/api/c_api.h"

typedef double real;
typedef int64_t whole;

/* A long source is compiled in pieces, with PIECE defined; IN says what belongs to one. */
#ifdef PIECE
#define IN(piece) (PIECE == (piece))
#define OWN __attribute__((visibility("hidden")))
#else
#define IN(piece) 1
#define OWN static
#endif

/* whether an integer left what doubles carry exactly, in this thread, since it was last cleared */
#ifndef PIECE
static _Thread_local int outside;
#elif PIECE == 0
OWN _Thread_local int outside;
#else
extern OWN _Thread_local int outside;
#endif

static void *allocate(size_t bytes) {
  void *memory = aligned_alloc(64, (bytes + 63) / 64 * 64);
  if (!memory) {
    fprintf(stderr, "colift native: no memory for %zu bytes\n", bytes);
    abort();
  }
  return memory;
}
