#include <math.h>
#include <pthread.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "xla/ffi/api/c_api.h"

/* whether an integer left what doubles carry exactly, in this thread, since it was last cleared */
static _Thread_local int outside;

static void *allocate(size_t bytes) {
  void *memory = aligned_alloc(64, (bytes + 63) / 64 * 64);
  if (!memory) {
    fprintf(stderr, "colift native: no memory for %zu bytes\n", bytes);
    abort();
  }
  return memory;
}
