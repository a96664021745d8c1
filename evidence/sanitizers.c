// Prints the commands of an exported controller as binary numbers, one row for each tick of a recorded flight.
#include <stdio.h>
#include <string.h>

#include "colift.h"

#define REAL(kind) (sizeof(kind) / sizeof(colift_real))
enum { MEASURED = REAL(colift_measurement), COMMANDED = REAL(colift_command), ROW = 1 + MEASURED + COMMANDED };

static colift_state state;
static colift_measurement m;
static colift_command command;

static void take(const double *row) {
  for (int i = 0; i < MEASURED; i++) ((colift_real *)&m)[i] = (colift_real)row[i];
}

int main(int argc, char **argv) {
  static double row[ROW];
  FILE *file = argc == 2 ? fopen(argv[1], "rb") : NULL;
  if (!file || fread(row, sizeof row, 1, file) != 1) return 2;
  take(row + 1);
  memset(&state, 0, sizeof state);
  colift_init(&colift_trained_model, &m, &state, &command);
  int overflow = 0;
  while (fread(row, sizeof row, 1, file) == 1) {
    take(row + 1);
    overflow |= colift_step(&colift_trained_model, (colift_real)row[0], &m, &state, &command);
    fwrite(&command, sizeof command, 1, stdout);
  }
  fclose(file);
  return overflow;
}
