/* Replays a recorded flight: runs the controller on the recorded measurements and compares its commands.
 *
 * usage: replay flight.bin [repeats]
 * The file contains rows of little-endian doubles: time, measurement, command. The first row is the measurement at
 * rest, without a command. The program prints the largest differences, absolute and relative to one plus the recorded
 * command, and the execution times of the steps.
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

static double now(void) { return clock() * (1e6 / CLOCKS_PER_SEC); } /* CPU time in us */

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
  double *flight = malloc(bytes), *durations = malloc((rows + 1) * sizeof(double) * repeats);
  if (!flight || !durations || rows < 2 || fread(flight, ROW * sizeof(double), rows, file) != (size_t)rows) {
    fprintf(stderr, "%s: not a recorded flight of this controller\n", argv[1]);
    return 2;
  }
  double largest = 0, share = 0;
  int overflow = 0;
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
      overflow |= colift_step(&colift_trained_model, (colift_real)row[0], &m, &state, &command);
      durations[steps] = now() - began;
      for (int j = 0; j < COMMANDED; j++) {
        const double want = row[1 + MEASURED + j], off = fabs((double)((colift_real *)&command)[j] - want);
        if (!(off <= largest)) largest = off;
        if (!(off / (1 + fabs(want)) <= share)) share = off / (1 + fabs(want));
      }
    }
  }
  qsort(durations, steps, sizeof *durations, ascending);
  printf("steps %ld\n", steps);
  printf("max_difference %.3g\n", largest);
  printf("max_relative_difference %.3g\n", share);
  printf("step_time_median_us %.2f\n", durations[steps / 2]);
  printf("step_time_p999_us %.2f\n", durations[(long)(0.999 * steps)]);
  printf("state_bytes %lu\n", (unsigned long)sizeof(colift_state));
  printf("model_bytes %lu\n", (unsigned long)sizeof(colift_model));
  if (overflow) fprintf(stderr, "integer overflow: a counter is not exactly representable\n");
  free(flight);
  free(durations);
  fclose(file);
  return overflow || !(largest <= HUGE_VAL);
}
