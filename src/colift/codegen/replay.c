/* Replays a flight: steps the pilot through what it measured then and compares its commands with those of then.
 *
 * usage: replay flight.bin [repeats]
 * Rows of doubles, little endian: time, measurement, command; the first is the reading at rest, without a command.
 * Prints the largest difference, absolute and as a share of each member's largest command, and the times of the steps.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "colift.h"

#define REAL(kind) (sizeof(kind) / sizeof(colift_real))
enum { MEASURED = REAL(colift_measurement), COMMANDED = REAL(colift_command), ROW = 1 + MEASURED + COMMANDED };

static colift_state state;

static void take(const double *row, void *into, int n) {
  for (int i = 0; i < n; i++) ((colift_real *)into)[i] = (colift_real)row[i];
}

static int ascending(const void *a, const void *b) {
  const double x = *(const double *)a, y = *(const double *)b;
  return (x > y) - (x < y);
}

static double now(void) { return clock() * (1e6 / CLOCKS_PER_SEC); } /* us of the processor */

int main(int argc, char **argv) {
  FILE *file = argc > 1 ? fopen(argv[1], "rb") : NULL;
  const int repeats = argc > 2 ? atoi(argv[2]) : 1;
  if (!file || repeats < 1) {
    fprintf(stderr, "usage: %s flight.bin [repeats]\n", argv[0]);
    return 2;
  }
  fseek(file, 0, SEEK_END);
  const long bytes = ftell(file), rows = bytes / (ROW * (long)sizeof(double));
  rewind(file);
  double *flight = malloc(bytes), *took = malloc((rows + 1) * sizeof(double) * repeats);
  if (!flight || !took || rows < 2 || fread(flight, ROW * sizeof(double), rows, file) != (size_t)rows) {
    fprintf(stderr, "%s: not a flight of this pilot\n", argv[1]);
    return 2;
  }
  double largest = 0, share = 0;
  int lost = 0;
  long steps = 0;
  for (int k = 0; k < repeats; k++) {
    colift_measurement m;
    colift_command command;
    take(flight + 1, &m, MEASURED);
    memset(&state, 0, sizeof state);
    colift_init(&colift_trained_model, &m, &state, &command);
    for (long i = 1; i < rows; i++, steps++) {
      const double *row = flight + i * ROW;
      take(row + 1, &m, MEASURED);
      const double began = now();
      lost |= colift_step(&colift_trained_model, (colift_real)row[0], &m, &state, &command);
      took[steps] = now() - began;
      for (int j = 0; j < COMMANDED; j++) {
        const double want = row[1 + MEASURED + j], off = fabs((double)((colift_real *)&command)[j] - want);
        if (!(off <= largest)) largest = off;
        if (!(off / (1 + fabs(want)) <= share)) share = off / (1 + fabs(want));
      }
    }
  }
  qsort(took, steps, sizeof *took, ascending);
  printf("steps %ld\n", steps);
  printf("largest_difference %.3g\n", largest);
  printf("largest_relative_difference %.3g\n", share);
  printf("median_us %.2f\n", took[steps / 2]);
  printf("p999_us %.2f\n", took[(long)(0.999 * steps)]);
  printf("state_bytes %lu\n", (unsigned long)sizeof(colift_state));
  printf("model_bytes %lu\n", (unsigned long)sizeof(colift_model));
  if (lost) fprintf(stderr, "a counter left the integers that are exact\n");
  free(flight);
  free(took);
  fclose(file);
  return lost || !(largest <= HUGE_VAL);
}
