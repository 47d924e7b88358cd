// Twins in lanes of the vectors that every processor of this kind has.

#define tenodesis tenodesis_narrow
#define TENODESIS_PROCESSOR narrow
#define TENODESIS_LANES 2
#include "engine/lane_runs.hpp"
