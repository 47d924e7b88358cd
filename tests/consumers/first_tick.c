/* Prints the output angle, rad, that the controller of an exported header estimates from one measurement. */
#include <stdio.h>

#include "scaled_up.h"
#include "tenodesis/tenodesis.h"

int main(void) {
  static tenodesis_controller controller;
  tenodesis_input input = {.request = TENODESIS_REQUEST_ENABLE,
                           .axis = {{.handle_angle = 0.3, .tension = {31, 19}, .spool_angle = {0.25, -0.125}}}};
  tenodesis_output output;
  if (tenodesis_real_size() != sizeof(tenodesis_real) || tenodesis_version() != TENODESIS_VERSION) return 1;
  if (tenodesis_init(&controller, &scaled_up) != TENODESIS_OK) return 1;
  if (tenodesis_step(&controller, &input, &output) != TENODESIS_OK) return 1;
  printf("%u %.17g\n", (unsigned)sizeof(tenodesis_real), output.axis[0].output_angle);
  return 0;
}
